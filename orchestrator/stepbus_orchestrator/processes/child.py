"""One participant's process, owned from its start to its end."""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from stepbus_orchestrator.errors import StartFailed

from .last_error import last_words

_TERM_GRACE_S = 1.0


class Child:
    """A process in a session of its own, so that Ctrl-C in the terminal does not reach it.

    name: the participant. log: where its stdout and stderr go. has_terminal: they go where ours
    go instead, and its stdin is ours. pid: its process id and group.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        *,
        cwd: Path,
        log: Path,
        environment: Mapping[str, str],
        has_terminal: bool = False,
    ) -> None:
        self.name = name
        self.log = log
        try:
            with log.open("ab") as file:
                if has_terminal:
                    file.write(b"its output went to the terminal (--debug)\n")
                self._process = subprocess.Popen(
                    command,
                    cwd=cwd,
                    env=environment,
                    stdin=None if has_terminal else subprocess.DEVNULL,
                    stdout=None if has_terminal else file,
                    stderr=None if has_terminal else subprocess.STDOUT,
                    start_new_session=True,
                )
        except OSError as exc:
            is_script = exc.errno == errno.ENOEXEC
            hint = "; a script begins with #! and its interpreter" if is_script else ""
            raise StartFailed(
                f"{name} could not be started: {' '.join(command)}: {exc.strerror or exc}{hint} "
                f"(participants.{name}.exec)",
                participant=name,
            ) from exc
        self.pid = self._process.pid

    def exit_code(self) -> int | None:
        """Return its exit code, negative for a signal; None while it runs."""
        return self._process.poll()

    def wait(self, timeout_s: float) -> bool:
        """Return whether it has ended within a time [s]."""
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return False
        return True

    def end(self) -> None:
        """Terminate it, then kill it and all it has started."""
        if self.exit_code() is None:
            self.signal(signal.SIGTERM)
            # A frozen process takes no SIGTERM until it goes on.
            self.signal(signal.SIGCONT)
            self.wait(_TERM_GRACE_S)
        self.signal(signal.SIGKILL)
        self._process.wait()

    def signal(self, number: int) -> None:
        """Send a signal to it and all it has started."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, number)

    def is_stopped(self) -> bool:
        """Return whether a signal or a debugger has stopped it; False where nobody knows."""
        try:
            fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return False
        return fields[0] in {"T", "t"}

    def how_it_ended(self) -> str:
        """Return its end in words: `exited with code 1` or `was killed by SIGKILL`."""
        code = self.exit_code()
        if code is not None and code < 0:
            return f"was killed by {signal.Signals(-code).name}"
        return f"exited with code {code}"

    def last_words(self) -> str:
        """Return the last complaint it printed, or its last line, or nothing."""
        return last_words(self.log)
