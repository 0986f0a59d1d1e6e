"""The reaper, as the orchestrator sees it; `reaper.py` is its program."""

import contextlib
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from stepbus_orchestrator.errors import StartFailed

_END_S = 2.0
"""How long the reaper may take to remove the private folder; it may have been stopped [s]."""


class LeftBehind(NamedTuple):
    """A process that outlived the participant that had started it, and was ended."""

    participant: str
    pid: str
    command: str

    def text(self) -> str:
        """Return it in words."""
        return f"left a process behind, which was killed: {self.command} (pid {self.pid})"


class Reaper:
    """Kills what is left of a run, also should the orchestrator be killed.

    folder: the run's private folder, removed at the end. Raises StartFailed, without leaving the
    folder behind, when no process can be started.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        try:
            self._process = _start(folder)
        except BaseException as exc:
            # It is empty. To remove it takes no file descriptor, of which there may be none left.
            with contextlib.suppress(OSError):
                folder.rmdir()
            if isinstance(exc, OSError):
                raise StartFailed(f"the reaper could not be started: {exc.strerror}") from exc
            raise

    def watch(self, group: int) -> None:
        """Let it kill a process group when the orchestrator is gone."""
        self._notify(f"+{group}")

    def forget(self, group: int) -> None:
        """Let it kill a process group no more."""
        self._notify(f"-{group}")

    def end(self) -> list[LeftBehind]:
        """End it, and remove the private folder; return the processes that it had to end."""
        try:
            said, _ = self._process.communicate(timeout=_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            said = ""
            with contextlib.suppress(subprocess.TimeoutExpired):
                said, _ = self._process.communicate(timeout=_END_S)
        # It may have been killed, or stopped, by another process.
        shutil.rmtree(self._folder, ignore_errors=True)
        return [LeftBehind(*line.split(" ", 2)) for line in said.splitlines()]

    def _notify(self, line: str) -> None:
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.write(line + "\n")
                self._process.stdin.flush()


def _start(folder: Path) -> subprocess.Popen[str]:
    program = Path(__file__).with_name("reaper.py")
    return subprocess.Popen(
        [sys.executable, "-I", "-S", str(program), str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
