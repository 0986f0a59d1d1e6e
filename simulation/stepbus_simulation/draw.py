"""What a tape is drawn from: first which kinds of faults take part, then the faults and the knobs.

`kinds` has how a fault of each kind is drawn.
"""

from dataclasses import dataclass, field
from random import Random

from .tape import MS, ORCHESTRATOR, Knobs

_LATEST_NS = 400 * MS
"""Most strikes by the clock come in this time: a run of 50 steps takes some 150 ms."""
_PREFERENCE = 0.5


@dataclass(frozen=True, kw_only=True)
class Draw:
    """What faults are drawn from: a generator, the names of the participants, the steps.

    preferred: a participant that is struck more often than others; faults of one meet. knobs: what
    lasts about as long as one of their deadlines is drawn more often.
    """

    random: Random
    names: list[str]
    steps: int
    preferred: str = ""
    knobs: Knobs = field(default_factory=Knobs)

    def name(self) -> str:
        """Return a participant: the preferred one, as often as any other."""
        if self.preferred and self.random.random() < _PREFERENCE:
            return self.preferred
        return self.random.choice(self.names)

    def of_step(self) -> tuple[str, int]:
        """Return a participant and a step, or the closing one."""
        steps = [self.random.randrange(self.steps), self.steps - 1, self.steps]
        return self.name(), self.random.choice(steps)

    def of_slow_step(self) -> tuple[str, int, int]:
        """Return a participant, a step, and how long something lasts [ns]."""
        return (*self.of_step(), self.lasting())

    def link(self) -> str:
        """Return a link from one process to another."""
        one, other = self.link_to_participant().split(">")
        return self.random.choice([f"{one}>{other}", f"{other}>{one}"])

    def link_to_participant(self) -> str:
        """Return a link to a participant; a log must come once (P8.6)."""
        one = self.name()
        other = self.random.choice([name for name in [*self.names, ORCHESTRATOR] if name != one])
        return f"{other}>{one}"

    def bulk_link(self) -> str:
        """Return a link that carries bulk content."""
        return self.random.choice([f"camera>{ORCHESTRATOR}", "camera>viewer"])

    def time(self) -> int:
        """Return a time at which something strikes [ns]."""
        return self.random.randrange(self.random.choice([1, 1, 5]) * _LATEST_NS)

    def lasting(self) -> int:
        """Return how long something lasts [ns]: a moment, about a deadline, or longer than most."""
        if self.random.random() < _PREFERENCE:
            return int(10 ** self.random.uniform(5, 10))
        phase = self.random.choice(["join", "ready", "step", "step", "step", "stop"])
        deadline_ns = MS * int(getattr(self.knobs, f"{phase}_ms"))
        return int(deadline_ns * self.random.uniform(0.8, 2.0))

    def call(self) -> int:
        """Return the number of a call of the machine: those of its start are few."""
        return int(10 ** self.random.uniform(0, 3))

    def few(self) -> int:
        """Return how many calls go wrong."""
        return self.random.randrange(1, 4)

    def message(self) -> int:
        """Return the number of a message of a link."""
        return self.random.randrange(2 * self.steps)


def draw_knobs(random: Random) -> Knobs:
    """Return knobs, each at its default or at what shows more."""
    defaults = Knobs()
    return Knobs(
        window=random.choice([1, 2, 3, 8, 64]),
        batch=random.choice([0, 0, 1]),
        spawn_ms=random.choice([defaults.spawn_ms, 1_000]),
        join_ms=random.choice([defaults.join_ms, 1_000]),
        ready_ms=random.choice([defaults.ready_ms, 1_000]),
        step_ms=random.choice([defaults.step_ms, 300, 1_000]),
        stop_ms=random.choice([defaults.stop_ms, 500]),
        compute_us=random.choice([0, 0, 100, 2_000, 10_000]),
        link_us=random.choice([30, 30, 1, 1_000]),
        buffer_bytes=random.choice([200_000, 20_000, 5_000]),
        chunk_bytes=random.choice([defaults.chunk_bytes, 2_000, 10_000]),
        heal_ms=random.choice([0, 0, 300, 2_000]),
    )
