"""A tape: everything that a simulated run depends on, as data that can be edited and kept."""

from pathlib import Path

import msgspec

MS = 1_000_000
"""A millisecond [ns]."""

ORCHESTRATOR = "orchestrator"
"""The name of its process."""

FOLDER = "/dev/shm"
"""Where simulated runs write: memory."""


class Fault(msgspec.Struct, frozen=True, omit_defaults=True):
    """One thing that goes wrong.

    kind: a row of `kinds.KINDS`. target: a process (`plant`), a link (`plant>controller`), or a
    call of the disk. at: when, in what its kind counts: nanoseconds, messages, steps or calls.
    amount: how long [ns], how much, or which, as its kind has it.
    """

    kind: str
    target: str = ""
    at: int = 0
    amount: int = 0

    def __str__(self) -> str:
        where = f" {self.target}" if self.target else ""
        return f"{self.kind}{where} at {self.at}" + (f" ({self.amount})" if self.amount else "")


class Knobs(msgspec.Struct, frozen=True, omit_defaults=True):
    """What may be set otherwise without a change of what is recorded.

    window: steps in flight. batch: steps that are published at once; 0: as many as the window
    allows. *_ms: deadlines. compute_us: what a step takes. link_us: delay of a link. buffer_bytes:
    what a link holds for a process that reads nothing. chunk_bytes: of the recording. heal_ms: when
    all that goes on is mended, so that the run has to come to its end; 0: never.
    """

    window: int = 64
    batch: int = 0
    spawn_ms: int = 20_000
    join_ms: int = 10_000
    ready_ms: int = 30_000
    step_ms: int = 3_000
    stop_ms: int = 3_000
    compute_us: int = 0
    link_us: int = 30
    buffer_bytes: int = 200_000
    chunk_bytes: int = 65_536
    heal_ms: int = 0

    @property
    def starting_ms(self) -> int:
        """Return how long the start may take [ms]."""
        return self.spawn_ms + self.join_ms + self.ready_ms

    @property
    def shortest_ns(self) -> int:
        """Return the shortest deadline [ns]."""
        return MS * min(self.spawn_ms, self.join_ms, self.ready_ms, self.step_ms, self.stop_ms)


class Tape(msgspec.Struct, frozen=True, omit_defaults=True):
    """One simulated run.

    scenario: a name of `programs.SCENARIOS`. then: what is done with its recording, a name of
    `follow_up.FOLLOW_UPS`, in a run without faults.
    """

    scenario: str = "loop"
    steps: int = 50
    knobs: Knobs = Knobs()
    faults: tuple[Fault, ...] = ()
    then: str = ""

    def save(self, path: Path) -> None:
        """Write it as JSON."""
        path.write_bytes(msgspec.json.format(msgspec.json.encode(self)) + b"\n")

    def __str__(self) -> str:
        return msgspec.json.encode(self).decode()


def load_tape(path: Path) -> Tape:
    """Return a tape; raises msgspec.DecodeError for what is none."""
    return msgspec.json.decode(path.read_bytes(), type=Tape)
