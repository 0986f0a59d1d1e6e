"""Checks what a run reported and left behind against the promises."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from . import log_reader
from .faults import Fault
from .sandbox import STEPBUS, Sandbox

ORPHAN_GRACE_S = 3.0


@dataclass
class Verdict:
    """What one case came to: exit code, how long after the fault, and every broken promise."""

    code: int | None
    seconds: float
    broken: list[str] = field(default_factory=list)


def judge(box: Sandbox, fault: Fault, limit_s: float) -> Verdict:
    """Wait for the end of the run and return what it broke.

    limit_s: how long after the fault it may take [s]; past it, it hangs.
    """
    code = _await_end(box, limit_s)
    verdict = Verdict(code, time.monotonic() - box.faulted_at)
    say = verdict.broken.append
    if code is None:
        say(f"hang: still running after {verdict.seconds:.1f} s")
        return verdict
    if code not in fault.codes:
        say(f"false exit code {code}, not one of {sorted(fault.codes)}")
    _check_orphans(box, say)
    _check_words(box, fault, code, say)
    _check_recording(box, code, say)
    return verdict


def _await_end(box: Sandbox, limit_s: float) -> int | None:
    while time.monotonic() < box.faulted_at + limit_s:
        if box.orchestrator.poll() is not None:
            return box.orchestrator.returncode
        time.sleep(0.01)
    return box.orchestrator.poll()


def _check_orphans(box: Sandbox, say: Callable[[str], None]) -> None:
    give_up = time.monotonic() + ORPHAN_GRACE_S
    while (left := box.processes()) and time.monotonic() < give_up:
        time.sleep(0.05)
    for process in left:
        say(f"orphan: {' '.join(process.cmdline())[-80:]}")
    while (kept := sorted(box.temporary.iterdir())) and time.monotonic() < give_up:
        time.sleep(0.05)
    if kept:
        say(f"left behind: {', '.join(path.name for path in kept)}")


def _check_words(box: Sandbox, fault: Fault, code: int, say: Callable[[str], None]) -> None:
    text = box.text("stdout") + box.text("stderr")
    if "Traceback" in text:
        say(f"traceback: {text.strip().splitlines()[-1][:120]}")
    result = log_reader.result(box.out)
    if code < 0 or not box.out.exists():
        return
    if result is None:
        if box.notes.get("stepped"):
            say("no result.json")
        return
    if result["exit_code"] != code:
        say(f"result.json says {result['exit_code']}, the exit code is {code}")
    hit = box.notes.get("hit")
    if fault.blames and result["participant"] != hit:
        say(f"wrong blame: {result['participant']} instead of {hit}: {result['reason']}")


def _check_recording(box: Sandbox, code: int, say: Callable[[str], None]) -> None:
    path = box.out / "run.mcap"
    log = log_reader.read(path)
    result = log_reader.result(box.out)
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
    command = [STEPBUS, "recover", str(box.out / "run.mcap"), "-o", str(box.home / "whole.mcap")]
    environment = {**os.environ, "TMPDIR": str(box.temporary)}
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=60, check=False, env=environment
    )
    return "undamaged" not in done.stdout + done.stderr
