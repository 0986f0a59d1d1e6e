"""Checks what a run reported and left behind against the promises."""

from __future__ import annotations

import os
import re
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from . import log_reader
from .faults import Fault
from .log_reader import Log
from .sandbox import MARK, STEPBUS, Sandbox

ORPHAN_GRACE_S = 3.0
_STEP_TIMEOUT, _INTERRUPTED = 6, 130

# Python itself, before any program of ours runs.
_NOT_OURS = re.compile(r"Error processing line \d+ of .*?Remainder of file ignored", re.DOTALL)
_SIGNS = ("Traceback (most recent call last)", "Exception ignored", "Fatal Python error")


@dataclass
class Verdict:
    """What one case came to.

    code: exit code; None where it hangs. seconds: how long it took after the fault. broken: every
    promise that was broken. said: the reason that the run gave. output: the end of what it said.
    missed: whether the run ended before the fault struck.
    """

    code: int | None
    seconds: float
    broken: list[str] = field(default_factory=list)
    said: str = ""
    output: str = ""
    missed: bool = False


def judge(box: Sandbox, fault: Fault, limit_s: float) -> Verdict:
    """Wait for the end of the run and return what it broke.

    limit_s: how long after the fault it may take [s]; past it, it hangs.
    """
    while time.monotonic() < box.faulted_at + limit_s and box.orchestrator.poll() is None:
        time.sleep(0.01)
    code = box.orchestrator.poll()
    verdict = Verdict(code, time.monotonic() - box.faulted_at)
    verdict.output = (box.text("stderr") + box.text("stdout")).strip()
    if code is None:
        verdict.broken.append(f"hang: still running after {verdict.seconds:.1f} s")
        return verdict
    verdict.missed = bool(box.notes.get("missed"))
    result = log_reader.result(box.out)
    verdict.said = result["reason"] if result else ""
    verdict.broken += _broken(box, fault, code, result)
    if sign := _traceback(verdict.output):
        verdict.broken.append(f"traceback: {sign!r}")
    return verdict


def _broken(box: Sandbox, fault: Fault, code: int, result: dict[str, Any] | None) -> Iterator[str]:
    """Yield each promise that a run which has ended broke, beside what it printed."""
    allowed = {0} if box.notes.get("missed") else fault.codes
    if code not in allowed:
        yield f"false exit code {code}, not one of {sorted(allowed)}"
    yield from _left(box, fault)
    log = log_reader.read(box.out / "run.mcap")
    if result is None:
        is_due = box.notes.get("stepped") and not box.notes.get("blocked")
        if code >= 0 and box.out.exists() and is_due:
            yield "no result.json"
    elif code >= 0 and result["exit_code"] != code:
        yield f"result.json says {result['exit_code']}, the exit code is {code}"
    if result is not None and result["exit_code"]:
        yield from _wrong_blame(box, fault, result, log)
    yield from _wrong_recording(box, code, result, log)


def _left(box: Sandbox, fault: Fault) -> Iterator[str]:
    """Yield what process or temporary file is left."""
    give_up = time.monotonic() + box.notes.get("grace_s", ORPHAN_GRACE_S)
    while (left := box.processes()) and time.monotonic() < give_up:
        time.sleep(0.05)
    for process in left:
        yield f"orphan: {' '.join(process.cmdline())[-80:]}"
    while (kept := sorted(box.temporary.iterdir())) and time.monotonic() < give_up:
        if fault.leaves:
            return
        time.sleep(0.05)
    if kept and not fault.leaves:
        yield f"left behind: {', '.join(path.name for path in kept)}"


def _traceback(text: str) -> str:
    """Return the end of a traceback in what a run has printed; empty: there is none."""
    own = _NOT_OURS.sub("", text)
    return next((own[own.index(sign) :].strip()[-200:] for sign in _SIGNS if sign in own), "")


def _wrong_blame(box: Sandbox, fault: Fault, result: dict[str, Any], log: Log) -> Iterator[str]:
    """Check whom the run names: against who was hit, and against what the log shows."""
    blamed, hit = result["participant"], box.notes.get("hit")
    said = f"{blamed}: {result['reason']}"
    is_interrupted = result["exit_code"] == _INTERRUPTED
    if fault.blames == "hit" and blamed != hit and not is_interrupted:
        yield f"wrong blame: not {hit} but {said}"
    if fault.blames == "nobody" and blamed is not None:
        yield f"wrong blame: no participant was hit, but it says {said}"
    if blamed is not None and blamed not in box.notes["participants"]:
        yield f"wrong blame: there is no participant {said}"
    # A participant that held a step has not published it.
    last = -1 if blamed is None or fault.blames == "any" else log.last_step_of(blamed)
    if result["exit_code"] == _STEP_TIMEOUT and last > result["at_step"]:
        yield f"wrong blame: the log has step {last} of {said}"


def _wrong_recording(
    box: Sandbox, code: int, result: dict[str, Any] | None, log: Log
) -> Iterator[str]:
    if code == 0 and result is not None:
        if log.sha256 != result["sha256"]:
            yield "result.json gives another SHA-256 than the recording has"
        if log.last_step not in {result["steps"], result["steps"] - 1}:
            yield f"finished {result['steps']} steps; the log ends at {log.last_step}"
    if code == 0 and box.notes.get("reference") not in {None, log.sha256}:
        yield "another recording than that of an undisturbed run"
    holes = log.holes()
    if holes and code == 0:
        yield f"finished with a hole: {holes[0]}"
    elif holes and not _is_reported(box):
        yield f"unreported hole: {holes[0]}"


def _is_reported(box: Sandbox) -> bool:
    """Return whether `stepbus recover` finds damage in the recording."""
    command = [STEPBUS, "recover", str(box.out / "run.mcap"), "--out", str(box.home / "whole.mcap")]
    environment = {**os.environ, MARK: box.mark, "TMPDIR": str(box.temporary)}
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=600, check=False, env=environment
    )
    said = done.stdout + done.stderr
    return "Traceback" not in said and ": undamaged" not in said
