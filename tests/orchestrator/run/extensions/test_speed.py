"""How fast a run goes by the wall clock, as asked while it goes on."""

from types import SimpleNamespace

from stepbus_orchestrator.run.extensions.real_time import Speed


class Clock:
    now = 100.0

    def monotonic_ns(self):
        return int(self.now * 1e9)


def by(clock, step_ns=10_000_000):
    speed = Speed(step_ns)
    speed.attach(SimpleNamespace(clock=clock))
    return speed


def test_steps_come_at_their_time():
    clock = Clock()
    speed = by(clock)
    speed.set(0.5, 40)
    assert speed.limit(40) == 41
    clock.now += 0.0201
    assert speed.limit(41) == 42
    assert 0.0 < speed.wait_s(42, 1.0) < 0.02
