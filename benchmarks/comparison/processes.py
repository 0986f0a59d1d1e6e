"""Start a tool, strike its controller from outside, and see how it ends.

Every process that a tool starts inherits a variable with a value of its own (`MARK`), by which it
is found in /proc, whatever session or parent it has.
"""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

MARK = "COMPARISON_MARK"
START_S, STALLED_S, GRACE_S, CLEAN_S = 120.0, 60.0, 20.0, 60.0
"""Time for a start; for a tool to end after the strike; after Ctrl-C; for what it left behind."""


def alive(mark: str) -> dict[int, str]:
    """Return pid → command line of the processes with this mark; zombies are none."""
    needle = f"{MARK}={mark}".encode()
    matches = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if needle in (folder / "environ").read_bytes().split(b"\0"):
                words = (folder / "cmdline").read_bytes().split(b"\0")
                matches[int(folder.name)] = " ".join(os.fsdecode(word) for word in words).strip()
    return matches


def end_all(mark: str) -> None:
    """Kill every process with this mark."""
    deadline = time.monotonic() + GRACE_S
    while (left := alive(mark)) and time.monotonic() < deadline:
        for pid in left:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.1)


def _until(condition: Callable[[], Any], seconds: float) -> bool:
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def run(
    command: Sequence[str], folder: Path, environment: Mapping[str, str], log: Path
) -> dict[str, Any]:
    """Run a command to its end; return its exit code (None: it had to be killed) and time."""
    began = time.monotonic()
    with start(command, folder, environment, log) as process:
        try:
            code: int | None = process.wait(START_S)
        except subprocess.TimeoutExpired:
            code = None
        seconds = time.monotonic() - began
        end_all(environment[MARK])
    return {"exit_code": code, "seconds": round(seconds, 1)}


def strike(
    process: subprocess.Popen[bytes],
    stalled: Path,
    mark: str,
    *,
    kill: bool,
    log: Path,
    clean_s: float = CLEAN_S,
) -> dict[str, Any]:
    """Wait for the controller to stop at its step; kill it there, or let it sleep.

    Returns whether the tool ended (`ended`: by itself, Ctrl-C, or killed), its exit code, the
    seconds from the strike to its end, and the processes that it left behind (`left`: at its end;
    `left_later`: of these, after `clean_s`), and what it wrote before anybody ended it (`log`).
    Raises RuntimeError if it never came so far.
    """
    with process:
        try:
            if not _until(lambda: stalled.exists() or process.poll() is not None, START_S):
                raise RuntimeError(f"{process.args!r}: the controller did not reach its step")
            if not stalled.exists():
                raise RuntimeError(f"{process.args!r}: ended with {process.returncode} too early")
            began = time.monotonic()
            if kill:
                os.kill(int(stalled.read_text()), signal.SIGKILL)
            result = _end(process, began, log)
            left = alive(mark)
            result["left"] = sorted(left.values())
            _until(lambda: not alive(mark), clean_s if left else 0)
            result["left_later"] = sorted(alive(mark).values())
            return result
        finally:
            end_all(mark)


def _end(process: subprocess.Popen[bytes], began: float, log: Path) -> dict[str, Any]:
    said = b""
    for ended, seconds in (("by itself", STALLED_S), ("Ctrl-C", GRACE_S), ("killed", GRACE_S)):
        try:
            code = process.wait(seconds)
        except subprocess.TimeoutExpired:
            said = said or log.read_bytes()
            # A terminal sends Ctrl-C to the whole process group.
            number = signal.SIGINT if ended == "by itself" else signal.SIGKILL
            with suppress(ProcessLookupError):
                os.killpg(process.pid, number)
            continue
        return {
            "ended": ended,
            "exit_code": code,
            "seconds": round(time.monotonic() - began, 1),
            "log": (said or log.read_bytes()).decode(errors="replace"),
        }
    raise RuntimeError(f"process {process.pid} cannot be killed")


def start(
    command: Sequence[str], folder: Path, environment: Mapping[str, str], log: Path
) -> subprocess.Popen[bytes]:
    """Start a command in a session of its own, with its output added to a log."""
    with log.open("ab") as file:
        return subprocess.Popen(
            command,
            cwd=folder,
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
