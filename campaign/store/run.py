"""Runs sales and judges them."""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from campaign import log_reader
from campaign.sandbox import STEPBUS

from .cases import Case
from .judge import excuses, judge, largest_force
from .log import decoded

_LONGEST_S = 1200.0
_PATIENCE = {"spawn_timeout": 120, "join_timeout": 60, "ready_timeout": 120, "step_timeout": 60}
"""Of every participant, so that the verdict does not depend on how fast the machine is [s]."""


@dataclass
class Outcome:
    """What a sale came to.

    code: None where it hangs. force: the largest one [N]. excused: what could not be avoided.
    """

    code: int | None
    seconds: float
    reason: str = ""
    force: float = 0.0
    broken: list[str] = field(default_factory=list)
    excused: list[str] = field(default_factory=list)


def sell(rows: Sequence[Case]) -> Iterator[tuple[Case, Outcome]]:
    """Run every case and yield what came of it."""
    for case in rows:
        with tempfile.TemporaryDirectory(prefix="sbs-") as folder:
            yield case, _sell(case, Path(folder) / "run")


def _sell(case: Case, out: Path) -> Outcome:
    names = ["plant", "perception", "mission", "controller", "planner"]
    names += ["world"] if case.scenario == "store" else []
    patience = [f"{name}.{key}={value}s" for name in names for key, value in _PATIENCE.items()]
    words = [word for item in patience for word in ("--set", item)]
    began = time.monotonic()
    command = [STEPBUS, "run", *case.arguments(), *words, "--no-report", "--out", str(out)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_LONGEST_S, check=False
        )
    except subprocess.TimeoutExpired:
        return Outcome(None, _LONGEST_S, broken=[f"still running after {_LONGEST_S:g} s"])
    outcome = Outcome(done.returncode, time.monotonic() - began)
    result, recording = log_reader.result(out), out / "run.mcap"
    if result is None or not recording.exists():
        outcome.broken = [f"no recording: {(done.stderr + done.stdout)[-300:]!r}"]
        return outcome
    recorded = log_reader.read(recording)
    log = decoded(recorded)
    outcome.reason, outcome.force = result["reason"], largest_force(log)
    excused = excuses(log, case.script)
    outcome.broken, outcome.excused = judge(log, result, case.killed, excused), excused.texts
    if "Traceback (most recent call last)" in done.stderr + done.stdout:
        outcome.broken.append("a traceback is printed")
    if recorded.sha256 != result["sha256"]:
        outcome.broken.append("result.json gives another SHA-256 than the recording has")
    outcome.broken += recorded.holes()
    return outcome
