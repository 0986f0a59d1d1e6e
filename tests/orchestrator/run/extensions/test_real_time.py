"""Steps begin on the grid of the clock, who is late is counted, and no byte changes."""

from fractions import Fraction
from types import SimpleNamespace

import pytest
from support.runs.joints import fault, run_joints, write_scenario
from support.runs.kernel import scenario, states

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.extensions.real_time import RealTime, Speed
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.state import RunState

MS = 1_000_000


class Clock:
    """Shows what a test sets [ns]."""

    def __init__(self):
        self.now = 7 * MS

    def monotonic_ns(self):
        return self.now


def made(factor=1.0, step_ns=5 * MS, state=None, others=lambda _: FAR):
    """Return a clock, and a run in real time whose step 0 begins now; others: all other gates."""
    clock, gate = Clock(), RealTime(step_ns, factor)
    state = state or RunState(scenario(window=1))
    gate.attach(SimpleNamespace(clock=clock, state=state, gates=[gate.limit, others]))
    gate.limit(0)
    return clock, gate


def test_steps_begin_on_the_grid_of_the_clock():
    clock, gate = made()
    limits = []
    for ms in (0, 4, 5, 9, 10, 26):
        clock.now = (7 + ms) * MS
        limits.append(gate.limit(0))
    assert limits == [1, 1, 2, 2, 3, 6]


def test_at_a_speed_that_is_asked_for_on_the_way_steps_come_at_their_time():
    clock, speed = Clock(), Speed(10 * MS)
    speed.attach(SimpleNamespace(clock=clock))
    speed.set(0.5, 40)
    assert speed.limit(40) == 41
    clock.now += 20 * MS + 1
    assert speed.limit(41) == 42
    assert 0.0 < speed.wait_s(42, 1.0) < 0.02


@pytest.mark.parametrize("factor", [0.3, 1.0, 3.0])
def test_the_grid_has_no_drift(factor):
    clock, gate = made(factor, 1_000_003)
    steps = 10_000_000
    due = Fraction(steps) * 1_000_003 / Fraction(factor).limit_denominator(1_000_000)
    clock.now = 7 * MS + int(due) - 1
    assert gate.limit(0) == steps
    clock.now += 2
    assert gate.limit(0) == steps + 1


def report(state, *names, step=0):
    for name in names:
        state.barrier.report(name, step)


def late_state():
    state = RunState(scenario(window=1, steps=100))
    state.participants = states(state.scenario)
    return state


def test_whoever_holds_a_step_past_its_time_is_counted():
    state = late_state()
    clock, gate = made(state=state)
    clock.now += 6 * MS
    gate.limit(1)
    clock.now += 1 * MS
    report(state, "plant", "mission", "controller")
    gate.limit(1)
    found = gate.lateness()
    assert (found.steps, found.max_us, found.p50_us) == (2, 2000.0, 2000.0)
    assert found.late == {"plant": 1, "mission": 1}
    assert {bound: n for bound, n in found.histogram.items() if n} == {"100": 1, "2000": 1}


def test_a_pause_moves_the_grid():
    state, held = late_state(), [1]
    clock, gate = made(state=state, others=lambda _: held[0])
    for name in state.participants:
        for step in range(0, 4, state.scenario.participant(name).every):
            state.barrier.report(name, step)
    clock.now += 1000 * MS
    gate.limit(1)
    held[0] = FAR
    gate.limit(1)
    assert gate.lateness().max_us == 0.0
    assert gate.lateness().late == {}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return run_joints(tmp_path_factory.mktemp("plain"), in_process=True)


def test_a_run_in_real_time_has_the_same_bytes_and_takes_its_time(tmp_path, plain):
    result = run_joints(tmp_path, extensions=[RealTime(5 * MS, 2.0)])
    assert (result.exit_code, result.sha256) == (0, plain.sha256)
    assert result.real_time.steps == 100
    assert sum(result.real_time.histogram.values()) == 100
    # 99 steps of 2.5 ms lie between the first and the last.
    assert result.wall_s >= 0.2475


@pytest.mark.slow
def test_who_is_late_fails_the_run_if_the_scenario_says_so(tmp_path):
    nap = fault("controller", "nap", 7)
    keeps = ("controller.real_time=true", "controller.on_late=fail")
    result = run_joints(tmp_path, nap, *keeps, extensions=[RealTime(5 * MS, 0.1)])
    assert (result.exit_code, result.participant) == (ExitCode.STEP_TIMEOUT, "controller")
    assert "(participants.controller.on_late)" in result.reason


def test_without_a_clock_nobody_has_to_keep_time(tmp_path, plain):
    keeps = ("controller.real_time=true", "controller.on_late=fail")
    assert run_joints(tmp_path, *keeps).sha256 == plain.sha256


def test_a_run_that_does_not_keep_real_time_is_told_with_who_held_it(tmp_path, capsys):
    scenario = write_scenario(tmp_path / "source")
    words = ["run", str(scenario), "--in-process", "--no-report", "--out", str(tmp_path / "out")]
    assert main([*words, "--real-time", "1000"]) == 0
    said = capsys.readouterr().out
    assert "\nattention real time was not kept: " in said
    assert "instead of 1000; the last step was " in said
    assert "late steps: " in said


@pytest.mark.parametrize(("late_ms", "text"), [(5, ""), (500, "0.50 instead of 1; the last")])
def test_what_counts_is_how_late_the_last_step_is(late_ms, text):
    state = late_state()
    clock, gate = made(state=state)
    for step in range(1, 100):
        clock.now = (7 + 5 * step) * MS + (late_ms * MS if step >= 50 else 0)
        report(state, *state.participants, step=step - 1)
        gate.limit(step)
    found = gate.lateness()
    assert found.kept == pytest.approx(500 / (500 + late_ms))
    assert bool(text) == bool(found.complaint())
    assert text in found.complaint()
