"""One `stepbus run` in a sandbox of its own, as its user would start it."""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

MARK = "STEPBUS_CAMPAIGN"
START_S = 120.0
"""How long a process of the run may take to appear [s]."""
STEPBUS = str(Path(sys.executable).with_name("stepbus"))
_STEPPING_BYTES = 4_000


class Missed(Exception):
    """The run ended before the fault struck."""


@dataclass
class Sandbox:
    """A folder, the orchestrator that runs in it, and every process that it started.

    home: everything the run may write to; its `tmp` is TMPDIR. faulted_at: when the fault struck,
    by the monotonic clock [s].
    """

    home: Path
    mark: str = field(default_factory=lambda: uuid.uuid4().hex)
    process: subprocess.Popen[bytes] | None = None
    faulted_at: float = 0.0
    helpers: list[subprocess.Popen[Any]] = field(default_factory=list)
    notes: dict[str, Any] = field(default_factory=dict)

    @property
    def out(self) -> Path:
        """Return the folder of the run."""
        return self.home / "disk" / "run"

    @property
    def temporary(self) -> Path:
        """Return the folder for temporary files."""
        return self.home / "tmp"

    @property
    def orchestrator(self) -> subprocess.Popen[bytes]:
        """Return the process of the orchestrator."""
        if self.process is None:
            raise RuntimeError("no process was started")
        return self.process

    def start(self, arguments: Sequence[str], before: Callable[[], None] | None = None) -> None:
        """Start `stepbus run …`; before: what its process does first."""
        with (self.home / "stdout").open("wb") as out, (self.home / "stderr").open("wb") as error:
            self.process = subprocess.Popen(
                [STEPBUS, "run", *arguments, "--out", str(self.out)],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=error,
                env={**os.environ, MARK: self.mark, "TMPDIR": str(self.temporary)},
                cwd=self.home,
                preexec_fn=lambda: _prepare(before),  # noqa: PLW1509  (the campaign has one thread)
                start_new_session=True,
            )

    def mount(self, name: str, options: str) -> bool:
        """Mount a file system in memory on a folder; return whether this user may."""
        command = ["mount", "-t", "tmpfs", "-o", options, "none", str(self.home / name)]
        return subprocess.run(command, capture_output=True, check=False).returncode == 0

    def processes(self) -> list[psutil.Process]:
        """Return what is alive of the run, the orchestrator included."""
        return [process for process in psutil.process_iter() if self._is_ours(process)]

    def _is_ours(self, process: psutil.Process) -> bool:
        with contextlib.suppress(psutil.Error, OSError):
            is_marked: bool = process.environ().get(MARK) == self.mark
            return is_marked and process.status() != psutil.STATUS_ZOMBIE
        return False

    def find(self, role: str) -> psutil.Process | None:
        """Return the process of a participant or of the reaper, once it is there."""
        for process in self.processes():
            with contextlib.suppress(psutil.Error, OSError):
                if _role(process) == role:
                    return process
        return None

    def wait_for(self, condition: Callable[[], object], seconds: float) -> bool:
        """Wait until a condition holds; return False when it does not, or the run has ended."""
        give_up = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > give_up or self.orchestrator.poll() is not None:
                return bool(condition())
            time.sleep(0.005)
        return True

    def takes_signals(self) -> bool:
        """Return whether our program runs; before its first line, it is Python that starts."""
        with contextlib.suppress(OSError, IndexError, ValueError):
            status = Path(f"/proc/{self.orchestrator.pid}/status").read_text()
            caught = int(status.partition("SigCgt:")[2].split()[0], 16)
            return bool(caught >> (signal.SIGTERM - 1) & 1)
        return False

    def is_stepping(self) -> bool:
        """Return whether steps have reached the recording, which is long behind its attachments."""
        with contextlib.suppress(OSError):
            size = (self.out / "run.mcap").stat().st_size
            if "attached" not in self.notes and any(self.temporary.glob("stepbus-*")):
                # They are written before the run makes its private folder.
                self.notes["attached"] = size
            return bool(size > self.notes.get("attached", 1 << 60) + _STEPPING_BYTES)
        return False

    def text(self, name: str) -> str:
        """Return what went to stdout or stderr."""
        path = self.home / name
        return path.read_text(errors="replace") if path.exists() else ""


Strike = Callable[[Sandbox, random.Random], None]
"""Strikes a run; raises Missed where that has ended before."""


def _prepare(before: Callable[[], None] | None) -> None:
    """Take signals as from a terminal, whatever `nohup` or a shell's `&` has made of them."""
    for number in (signal.SIGHUP, signal.SIGQUIT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if before is not None:
        before()


def _role(process: psutil.Process) -> str:
    if any(word.endswith("reaper.py") for word in process.cmdline()):
        return "reaper"
    tickets = [value for value in process.environ().values() if value.endswith(".ticket")]
    return Path(tickets[0]).stem if tickets else ""


@contextlib.contextmanager
def sandbox() -> Iterator[Sandbox]:
    """Make a sandbox, and end and remove everything of it afterwards."""
    home = Path(tempfile.mkdtemp(prefix="sbc-"))
    box = Sandbox(home)
    (home / "tmp").mkdir()
    (home / "disk").mkdir()
    try:
        yield box
    finally:
        for helper in box.helpers:
            with helper:
                helper.kill()
        for process in box.processes():
            with contextlib.suppress(psutil.Error):
                process.kill()
        if box.process is not None:
            box.process.wait()
        for folder in (home / "disk", home / "tmp"):
            if os.path.ismount(folder):
                subprocess.run(["umount", "-l", str(folder)], check=False)
        shutil.rmtree(home, ignore_errors=True)
