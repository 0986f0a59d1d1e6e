"""How long the participants computed and waited, from timing.mcap."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording, layout
from stepbus_orchestrator.toolkit import StepTiming

EDGES_US: NDArray[np.float64] = np.logspace(0, 6, 37)
"""Of the bins of the histogram [µs]; the last one has the rest too."""

_decode = msgspec.msgpack.Decoder(StepTiming).decode


@dataclass
class StepTimes:
    """The times of one participant's steps. compute, wait: sums [ns]. counts: of each bin."""

    steps: int = 0
    compute: int = 0
    wait: int = 0
    longest: int = 0
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(EDGES_US), np.int64))

    def take(self, timing: StepTiming) -> None:
        """Take the next steps."""
        rows = np.array(timing.rows, dtype=np.int64).reshape(-1, 3)
        self.steps += len(rows)
        self.wait += int(rows[:, 1].sum())
        self.compute += int(rows[:, 2].sum())
        self.longest = max(self.longest, int(rows[:, 2].max(initial=0)))
        at = np.searchsorted(EDGES_US, rows[:, 2] * 1e-3)
        self.counts += np.bincount(np.minimum(at, len(EDGES_US) - 1), minlength=len(EDGES_US))

    def quantile_us(self, share: float) -> float:
        """Return an upper bound of a share of the compute times [µs]."""
        at = int(np.searchsorted(np.cumsum(self.counts), share * self.steps))
        return float(EDGES_US[min(at, len(EDGES_US) - 1)])


def step_times(folder: Path) -> Mapping[str, StepTimes]:
    """Return participant → its step times; none without a timing.mcap that can be read."""
    found: dict[str, StepTimes] = {}
    try:
        with Recording(folder / layout.TIMING_FILE) as recording:
            port = recording.ports.get("steps")
            for entry in port.entries() if port else ():
                timing = _decode(entry.data)
                found.setdefault(timing.participant, StepTimes()).take(timing)
    except (RecordingFailed, msgspec.MsgspecError):
        return found
    return found
