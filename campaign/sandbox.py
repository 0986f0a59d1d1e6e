"""One `stepbus run` in a sandbox of its own, as its user would start it."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import psutil

MARK = "STEPBUS_CAMPAIGN"
SHARED_MEMORY = Path("/dev/shm")  # noqa: S108  (it is read only)
_STEPPING_BYTES = 4_000
STEPBUS = str(Path(sys.executable).with_name("stepbus"))


@dataclass
class Sandbox:
    """A folder, the orchestrator that runs in it, and every process that it started.

    home: everything the run may write to; its `tmp` is TMPDIR. faulted_at: when the fault struck,
    by the monotonic clock [s]. shared: names of the shared memory that its processes have used.
    """

    home: Path
    mark: str = field(default_factory=lambda: uuid.uuid4().hex)
    process: subprocess.Popen[bytes] | None = None
    faulted_at: float = 0.0
    helpers: list[subprocess.Popen[Any]] = field(default_factory=list)
    notes: dict[str, Any] = field(default_factory=dict)
    shared: set[str] = field(default_factory=set)

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

    def start(
        self,
        arguments: Sequence[str],
        *,
        stdout: int | None = None,
        stderr: int | None = None,
        before: Callable[[], None] | None = None,
        environment: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Start `stepbus run …`; stdout and stderr go to files by default."""
        own = {MARK: self.mark, "TMPDIR": str(self.temporary)}
        self.process = subprocess.Popen(
            [STEPBUS, "run", *arguments, "--out", str(self.out)],
            stdin=subprocess.DEVNULL,
            stdout=stdout if stdout is not None else (self.home / "stdout").open("wb"),
            stderr=stderr if stderr is not None else (self.home / "stderr").open("wb"),
            env={**os.environ, **environment, **own},
            cwd=self.home,
            preexec_fn=lambda: _prepare(before),  # noqa: PLW1509  (the campaign has one thread)
            start_new_session=True,
        )

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
        recording = self.out / "run.mcap"
        with contextlib.suppress(OSError):
            size = recording.stat().st_size
            if "attached" not in self.notes and any(self.temporary.glob("stepbus-*")):
                # They are written before the run makes its private folder.
                self.notes["attached"] = size
            return bool(size > self.notes.get("attached", 1 << 60) + _STEPPING_BYTES)
        return False

    def see_shared_memory(self) -> None:
        """Add what shared memory the processes of the run use now."""
        for process in self.processes():
            with contextlib.suppress(psutil.Error, OSError):
                rows = Path(f"/proc/{process.pid}/maps").read_text().splitlines()
                paths = [Path(row.rpartition(" ")[2]) for row in rows]
                self.shared.update(p.name for p in paths if p.parent == SHARED_MEMORY)

    def left_shared_memory(self) -> set[str]:
        """Return what shared memory is left of what was seen; that of others is not ours."""
        return {name for name in self.shared if (SHARED_MEMORY / name).exists()}

    def text(self, name: str) -> str:
        """Return what went to stdout or stderr."""
        path = self.home / name
        return path.read_text(errors="replace") if path.exists() else ""


def _prepare(before: Callable[[], None] | None) -> None:
    """Take signals as from a terminal, whatever `nohup` or a shell's `&` has made of them."""
    for number in (signal.SIGHUP, signal.SIGQUIT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if before is not None:
        before()


def _role(process: psutil.Process) -> str:
    words = process.cmdline()
    if any(word.endswith("reaper.py") for word in words):
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
            with contextlib.suppress(ProcessLookupError):
                helper.send_signal(signal.SIGCONT)
                helper.kill()
            helper.wait()
        for process in box.processes():
            with contextlib.suppress(psutil.Error):
                process.kill()
        if box.process is not None:
            box.process.wait()
        for folder in (home / "disk", home / "tmp"):
            if os.path.ismount(folder):
                subprocess.run(["umount", "-l", str(folder)], check=False)
        shutil.rmtree(home, ignore_errors=True)
