"""Checks what a run reported and left behind against the promises."""

from __future__ import annotations

import os
import re
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from . import log_reader
from .faults import Fault
from .log_reader import Log
from .sandbox import MARK, SHARED_MEMORY, STEPBUS, Sandbox

ORPHAN_GRACE_S = 3.0
_LOOK_S = 1.0
_STEP_TIMEOUT, _INTERRUPTED = 6, 130

# Python itself, before any program of ours runs.
_NOT_OURS = re.compile(r"Error processing line \d+ of .*?Remainder of file ignored", re.DOTALL)

Say = Callable[[str], None]


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
    code = _await_end(box, limit_s)
    verdict = Verdict(code, time.monotonic() - box.faulted_at)
    verdict.output = (box.text("stderr") + box.text("stdout")).strip()
    say = verdict.broken.append
    if code is None:
        say(f"hang: still running after {verdict.seconds:.1f} s")
        return verdict
    verdict.missed = bool(box.notes.get("missed"))
    if code not in (fault.codes if not verdict.missed else {0}):
        say(f"false exit code {code}, not one of {sorted(fault.codes)}")
    result = log_reader.result(box.out)
    verdict.said = result["reason"] if result else ""
    log = log_reader.read(box.out / "run.mcap")
    _check_left(box, fault, say)
    _check_output(verdict.output, say)
    if code >= 0 and box.out.exists():
        _check_result(box, code, result, say)
    if result is not None and result["exit_code"]:
        _check_blame(box, fault, result, log, say)
    _check_recording(box, code, result, log, say)
    return verdict


def _await_end(box: Sandbox, limit_s: float) -> int | None:
    seen_at = 0.0
    while time.monotonic() < box.faulted_at + limit_s:
        if box.orchestrator.poll() is not None:
            break
        if time.monotonic() > seen_at + _LOOK_S:
            box.see_shared_memory()
            seen_at = time.monotonic()
        time.sleep(0.01)
    return box.orchestrator.poll()


def _check_left(box: Sandbox, fault: Fault, say: Say) -> None:
    """Check that no process and no temporary file is left."""
    give_up = time.monotonic() + box.notes.get("grace_s", ORPHAN_GRACE_S)
    while (left := box.processes()) and time.monotonic() < give_up:
        time.sleep(0.05)
    for process in left:
        say(f"orphan: {' '.join(process.cmdline())[-80:]}")
    if fault.leaves:
        return
    while (kept := sorted(box.temporary.iterdir())) and time.monotonic() < give_up:
        time.sleep(0.05)
    if kept:
        say(f"left behind: {', '.join(path.name for path in kept)}")
    if shared := box.left_shared_memory():
        say(f"left in {SHARED_MEMORY}: {', '.join(sorted(shared))}")


def _check_output(text: str, say: Say) -> None:
    own = _NOT_OURS.sub("", text)
    for sign in ("Traceback (most recent call last)", "Exception ignored", "Fatal Python error"):
        if sign in own:
            say(f"traceback: {own[own.index(sign) :].strip()[-200:]!r}")
            return


def _check_result(box: Sandbox, code: int, result: dict[str, Any] | None, say: Say) -> None:
    if result is None:
        if box.notes.get("stepped") and not box.notes.get("blocked"):
            say("no result.json")
    elif result["exit_code"] != code:
        say(f"result.json says {result['exit_code']}, the exit code is {code}")


def _check_blame(box: Sandbox, fault: Fault, result: dict[str, Any], log: Log, say: Say) -> None:
    """Check whom the run names: against who was hit, and against what the log shows."""
    blamed, hit = result["participant"], box.notes.get("hit")
    said = f"{blamed}: {result['reason']}"
    is_interrupted = result["exit_code"] == _INTERRUPTED
    if fault.blames == "hit" and blamed != hit and not is_interrupted:
        say(f"wrong blame: not {hit} but {said}")
    if fault.blames == "nobody" and blamed is not None:
        say(f"wrong blame: no participant was hit, but it says {said}")
    if blamed is not None and blamed not in box.notes["participants"]:
        say(f"wrong blame: there is no participant {said}")
    # A participant that held a step has not published it.
    last = -1 if blamed is None or fault.blames == "any" else log.last_step_of(blamed)
    if result["exit_code"] == _STEP_TIMEOUT and last > result["at_step"]:
        say(f"wrong blame: the log has step {last} of {said}")


def _check_recording(
    box: Sandbox, code: int, result: dict[str, Any] | None, log: Log, say: Say
) -> None:
    if code == 0 and result is not None:
        if log.sha256 != result["sha256"]:
            say("result.json gives another SHA-256 than the recording has")
        if log.last_step not in {result["steps"], result["steps"] - 1}:
            say(f"finished {result['steps']} steps; the log ends at {log.last_step}")
    if code == 0 and box.notes.get("reference") not in {None, log.sha256}:
        say("another recording than that of an undisturbed run")
    if log.holes and not _is_reported(box):
        say(f"unreported hole: {log.holes[0]}")


def _is_reported(box: Sandbox) -> bool:
    """Return whether `stepbus recover` finds damage in the recording."""
    command = [STEPBUS, "recover", str(box.out / "run.mcap"), "--out", str(box.home / "whole.mcap")]
    environment = {**os.environ, MARK: box.mark, "TMPDIR": str(box.temporary)}
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=600, check=False, env=environment
    )
    said = done.stdout + done.stderr
    return "Traceback" not in said and ": undamaged" not in said
