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
from typing import IO, Any

from stepbus_orchestrator.cli.terminal.output import print_error

_PATIENCE_S = 1.0
"""How long the end of a command waits for a reader that takes nothing [s]."""
_BACKLOG_BYTES = 1 << 20
_CHUNK_BYTES = 4096
"""A pipe that takes anything takes as much (PIPE_BUF)."""


class StdoutBuffer(io.FileIO):
    """Writes to a copy of a descriptor, and keeps what its reader does not take yet.

    is_needed: without the output, the command has failed, so a write waits for the reader as long
    as it takes, as a pager needs; otherwise it never waits, and what comes beyond 1 MiB is left
    out. backlog: what was not written yet. failure: why nothing more can be written; 0: none.
    is_incomplete: something was left out.
    """

    def __init__(self, descriptor: int) -> None:
        # A copy: a run in one process sends what libraries in C print elsewhere.
        super().__init__(_nonblocking_terminal(descriptor) or os.dup(descriptor), "w")
        self._lock = threading.Lock()
        self.backlog = bytearray()
        self.failure = 0
        self.is_needed = True
        self.is_incomplete = False

    def write(self, data: Any) -> int:
        """Write bytes, or keep them for later."""
        if len(self.backlog) > _BACKLOG_BYTES:
            self.is_incomplete = True
        else:
            self.backlog += data
        self.flush()
        return len(data)

    def flush(self) -> None:
        """Write the backlog, as far as the reader takes it."""
        self._drain(None if self.is_needed else 0.0)

    def finish(self) -> None:
        """Give the reader a last chance, then leave out what it has not taken."""
        self._drain(_PATIENCE_S)
        self.is_incomplete |= bool(self.backlog)

    def _drain(self, patience_s: float | None) -> None:
        """Write the backlog; give up once the reader has taken nothing for so long [s]."""
        with self._lock:
            try:
                while self.backlog and select.select([], [self], [], patience_s)[1]:
                    written = super().write(self.backlog[:_CHUNK_BYTES])
                    # None: a terminal has room, but too little.
                    if written is None and patience_s is not None:
                        return
                    del self.backlog[: written or 0]
            except OSError as exc:
                self.failure = exc.errno or errno.EIO
                self.backlog.clear()


def _nonblocking_terminal(descriptor: int) -> int | None:
    """Open a terminal anew, so that it does not block here but still does for other processes."""
    if os.isatty(descriptor):
        # It may belong to another user.
        with contextlib.suppress(OSError):
            flags = os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY
            return os.open(f"/proc/self/fd/{descriptor}", flags)
    return None


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
        # A closed pipe is how `head` ends, and there is no user at a closed terminal.
        if output.failure not in {0, errno.EPIPE, errno.EIO}:
            output.is_incomplete = True
            print_error(f"stdout: {os.strerror(output.failure)}; the output is incomplete")
        elif output.is_incomplete:
            print_error("stdout: no process reads it; the output is incomplete")
        error.finish()
        sys.stdout, sys.stderr = before


def hurry() -> None:
    """Wait for no reader from now on: a run ends in time and well though no process reads it."""
    for stream in (sys.stdout, sys.stderr):
        if (buffer := _buffer_of(stream)) is not None:
            buffer.is_needed = False


def is_held(stream: IO[str]) -> bool:
    """Return whether the reader of a stream does not take what was written so far."""
    stream.flush()
    buffer = _buffer_of(stream)
    return buffer is not None and bool(buffer.backlog)


def _buffer_of(stream: IO[str]) -> StdoutBuffer | None:
    buffer = getattr(stream, "buffer", None)
    return buffer if isinstance(buffer, StdoutBuffer) else None
