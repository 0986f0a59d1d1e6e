"""The scenarios that the campaign strikes, and how they are run in it."""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from .log_reader import result
from .sandbox import STEPBUS

_ATTEMPTS = 3
_ENDLESS = "1000s"
_LONGEST_S = 600.0
ARM = ("plant", "controller", "mission")
STORE = ("plant", "perception", "mission", "controller", "planner")


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One scenario that ships.

    participants: their names. duration: of a run that ends by itself. start_s, step_s: deadlines
    of each phase of the start, and of a step and of the end [s]. weight: how often it comes in
    turn. still: settings of a run that ends by the fault only.
    """

    participants: tuple[str, ...] = ARM
    duration: str = "60s"
    start_s: float = 8.0
    step_s: float = 2.0
    weight: int = 2
    still: tuple[str, ...] = ()

    def patient(self, patience: float) -> Scenario:
        """Return the scenario with deadlines that are so many times as long."""
        return replace(self, start_s=patience * self.start_s, step_s=patience * self.step_s)

    def endless(self, name: str) -> list[str]:
        """Return the arguments of a run that ends by the fault only."""
        further = [word for item in self.still for word in ("--set", item)]
        return [*self.arguments(name, _ENDLESS), *further]

    def arguments(self, name: str, duration: str) -> list[str]:
        """Return the arguments of a run with these deadlines."""
        phases = {"spawn": self.start_s, "join": self.start_s, "ready": self.start_s}
        phases |= {"step": self.step_s, "stop": self.step_s}
        deadlines = [
            f"{participant}.{phase}_timeout={seconds:g}s"
            for participant in self.participants
            for phase, seconds in phases.items()
        ]
        sets = [f"duration={duration}", *deadlines]
        return [name, *(word for item in sets for word in ("--set", item))]


# Without a script nothing ends a sale before the fault does.
_STORE = Scenario(
    participants=STORE, duration="4800ms", start_s=30.0, step_s=6.0, weight=1,
    still=("plant.params.script=[]",),
)  # fmt: skip
SCENARIOS: Mapping[str, Scenario] = {
    "two_link": Scenario(weight=4),
    **{
        f"two_link/{name}": Scenario()
        for name in ("pd", "pid", "pd_gravity", "velocity_force", "encoders")
    },
    "baxter": Scenario(weight=3, start_s=12.0),
    "baxter/round_trip": Scenario(start_s=20.0, step_s=4.0),
    **{f"store/{name}": _STORE for name in ("truth", "obstacle", "heavy", "no_path")},
    # A wheel jams at 1.5 s; soon afterwards the sale fails, as it should.
    "store/jammed": replace(_STORE, duration="1792ms"),
    "store": replace(_STORE, participants=(*STORE, "world")),
    "store/dead_camera": replace(_STORE, participants=(*STORE, "world")),
}  # fmt: skip


@dataclass(frozen=True)
class Reference:
    """An undisturbed run: SHA-256 of its recording, how long it took [s], what was wrong with it.

    wrong: exit code and output; empty where it finished.
    """

    sha256: str
    seconds: float
    wrong: str = ""


@cache
def reference(name: str, patience: float) -> Reference:
    """Run a scenario undisturbed, once."""
    row = SCENARIOS[name].patient(patience)
    # The deadlines are in the recording, so they must be the same, also on a machine that is busy.
    attempts = [Reference("", 0.0, "not run")]
    while attempts[-1].wrong and len(attempts) <= _ATTEMPTS:
        attempts.append(_reference(row.arguments(name, row.duration)))
    return attempts[-1]


def _reference(words: Sequence[str]) -> Reference:
    with tempfile.TemporaryDirectory(prefix="sbc-") as folder:
        out, began = Path(folder) / "run", time.monotonic()
        command = [STEPBUS, "run", *words, "--no-report", "--out", str(out)]
        done = subprocess.run(
            command, check=False, capture_output=True, text=True, timeout=_LONGEST_S
        )
        content, seconds = result(out), time.monotonic() - began
        if done.returncode or content is None:
            said = (done.stdout + done.stderr)[-2000:]
            return Reference("", seconds, f"exit code {done.returncode}: {said}")
        return Reference(content["sha256"], seconds)
