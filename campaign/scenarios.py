"""The scenarios that the campaign strikes, and how they are run in it."""

from __future__ import annotations

import contextlib
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from .log_reader import result
from .sandbox import STEPBUS

_ATTEMPTS = 3
ARM = ("plant", "controller", "mission")
STORE = ("plant", "perception", "mission", "controller", "planner")


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One scenario that ships.

    participants: their names. duration: of a run that ends by itself. endless: of one that does
    not. start_s, step_s: deadlines of each phase of the start, and of a step and of the end [s].
    weight: how often it is chosen.
    """

    participants: tuple[str, ...] = ARM
    duration: str = "10s"
    endless: str = "1000s"
    start_s: float = 8.0
    step_s: float = 2.0
    weight: float = 2.0

    def arguments(self, name: str, duration: str) -> list[str]:
        """Return the arguments of a run with short deadlines."""
        phases = {"spawn": self.start_s, "join": self.start_s, "ready": self.start_s}
        phases |= {"step": self.step_s, "stop": self.step_s}
        deadlines = [
            f"{participant}.{phase}_timeout={seconds:g}s"
            for participant in self.participants
            for phase, seconds in phases.items()
        ]
        sets = [f"duration={duration}", *deadlines]
        return [name, *(word for item in sets for word in ("--set", item))]


_STORE = Scenario(participants=STORE, duration="2400ms", start_s=30.0, step_s=6.0, weight=0.6)
SCENARIOS: Mapping[str, Scenario] = {
    "two_link": Scenario(weight=4.0),
    **{
        f"two_link/{name}": Scenario()
        for name in ("pd", "pid", "pd_gravity", "velocity_force", "encoders")
    },
    "baxter": Scenario(weight=3.0, start_s=12.0),
    "baxter/round_trip": Scenario(weight=1.5, start_s=20.0, step_s=4.0),
    **{
        f"store/{name}": _STORE
        for name in ("truth", "obstacle", "heavy", "jammed", "no_path")
    },
    "store": _STORE,
    "store/dead_camera": _STORE,
}  # fmt: skip


@dataclass(frozen=True)
class Reference:
    """An undisturbed run: SHA-256 of its recording, and how long it took [s]."""

    sha256: str
    seconds: float


@cache
def reference(name: str) -> Reference:
    """Run a scenario undisturbed, once; raises CalledProcessError where that fails."""
    row = SCENARIOS[name]
    # The deadlines are in the recording, so they must be the same, also on a machine that is busy.
    for _ in range(_ATTEMPTS - 1):
        with contextlib.suppress(subprocess.CalledProcessError):
            return _reference(row.arguments(name, row.duration))
    return _reference(row.arguments(name, row.duration))


def _reference(words: Sequence[str]) -> Reference:
    with tempfile.TemporaryDirectory(prefix="sbc-") as folder:
        out, began = Path(folder) / "run", time.monotonic()
        command = [STEPBUS, "run", *words, "--no-report", "--out", str(out)]
        subprocess.run(command, check=True, capture_output=True, timeout=300)
        content = result(out)
        return Reference(content["sha256"] if content else "", time.monotonic() - began)
