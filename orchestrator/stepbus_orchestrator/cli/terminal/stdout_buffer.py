"""Standard output and error that neither fail nor hold up their writer.

A run ends with its own exit code and in its own time, whatever becomes of its output: a pipe that
its reader has closed, a full disk, a terminal that Ctrl-S holds or that is not read. A command that
is there for its output fails without.
"""

import contextlib
import errno
import io
import os
import select
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from stepbus_orchestrator.cli.terminal.output import print_error

_PATIENCE_S = 1.0
"""How long the end of a command waits for a reader that takes nothing [s]."""
_CHUNK_BYTES = 4096
"""A pipe that takes anything takes as much (PIPE_BUF)."""


class StdoutBuffer(io.FileIO):
    """Writes to a copy of a descriptor, and keeps what its reader does not take yet.

    is_needed: without the output, the command has failed, so a write waits for the reader as long
    as it takes, as a pager needs; otherwise it never waits. backlog: what was not written yet.
    failure: why nothing more can be written; empty: nothing is wrong.
    """

    def __init__(self, descriptor: int) -> None:
        self._chunk = _CHUNK_BYTES
        copy = -1
        if os.isatty(descriptor):
            # A terminal opened anew does not block here, but still does for other processes.
            flags = os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY
            with contextlib.suppress(OSError):
                copy = os.open(f"/proc/self/fd/{descriptor}", flags)
            # That of another user, as after `su`, takes at least one byte without blocking.
            self._chunk = _CHUNK_BYTES if copy >= 0 else 1
        # A copy: a run in one process sends what libraries in C print elsewhere.
        super().__init__(copy if copy >= 0 else os.dup(descriptor), "w")
        self._lock = threading.Lock()
        self.backlog = bytearray()
        self.failure = ""
        self.is_needed = True

    def write(self, data: Any) -> int:
        """Write bytes, or keep them for later."""
        self.backlog += data
        self.flush()
        return len(data)

    def flush(self) -> None:
        """Write the backlog, as far as the reader takes it."""
        self._drain(None if self.is_needed else 0.0)

    def finish(self) -> None:
        """Give the reader a last chance, then leave out what it has not taken."""
        self._drain(_PATIENCE_S)
        if self.backlog:
            self.failure = "no process reads it"

    def _drain(self, patience_s: float | None) -> None:
        """Write the backlog; give up once the reader has taken nothing for so long [s]."""
        with self._lock:
            try:
                while self.backlog and select.select([], [self], [], patience_s)[1]:
                    written = super().write(self.backlog[: self._chunk])
                    # None: a terminal has room, but too little.
                    if written is None and patience_s is not None:
                        return
                    del self.backlog[: written or 0]
            except OSError as exc:
                # A closed pipe is how `head` ends, and there is no user at a closed terminal.
                is_end = exc.errno in {errno.EPIPE, errno.EIO}
                self.failure = self.failure or ("" if is_end else os.strerror(exc.errno or 0))
                self.backlog.clear()


@contextlib.contextmanager
def buffered() -> Iterator[tuple[StdoutBuffer, StdoutBuffer]]:
    """Yield the buffers of standard output and error; report what was lost at the end."""
    # Python has None where a stream is closed, as after `stepbus run … <&-`, and the next file that
    # is opened would get its descriptor.
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115
    before = sys.stdout, sys.stderr
    output, error = (StdoutBuffer(stream.fileno()) for stream in before)
    sys.stdout, sys.stderr = (
        io.TextIOWrapper(buffer, encoding=s.encoding, errors=s.errors, write_through=True)
        for buffer, s in zip((output, error), before, strict=True)
    )
    try:
        yield output, error
    finally:
        output.finish()
        if output.failure:
            print_error(f"stdout: {output.failure}; the output is incomplete")
        error.finish()
        sys.stdout, sys.stderr = before


def hurry() -> None:
    """Wait for no reader from now on: a run ends in time and well though no process reads it."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(buffer := getattr(stream, "buffer", None), StdoutBuffer):
            buffer.is_needed = False


def is_read() -> bool:
    """Return False once the pipe or terminal of standard output is closed at its other end."""
    poll = select.poll()
    if isinstance(buffer := getattr(sys.stdout, "buffer", None), StdoutBuffer):
        poll.register(buffer, 0)
    return not poll.poll(0)
