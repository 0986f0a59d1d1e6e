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

_POLL_S = 0.5
_PATIENCE_S = 1.0
"""How long a run waits for a reader that takes nothing [s]."""
_BACKLOG_BYTES = 1 << 16
_CHUNK_BYTES = 4096


class StdoutBuffer(io.BufferedIOBase):
    """Writes to a descriptor from a thread of its own.

    patience_s: how long a write waits for a reader that takes nothing [s]; None: for ever, as a
    pager needs. Once a reader has been waited for in vain, no write waits until it reads again,
    and what comes beyond 64 KiB of backlog is left out. failure: why nothing more can be written;
    0: none. is_incomplete: something was left out. is_needed: without, the command has failed.
    is_mute: the buffer beside it, of standard error, could not be written.
    """

    is_needed = True
    is_mute = False

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._changed = threading.Condition()
        self._waiting = bytearray()
        self._is_stuck = False
        self._thread: threading.Thread | None = None
        self.patience_s: float | None = None
        self.failure = 0
        self.is_incomplete = False

    def writable(self) -> bool:
        """Return True."""
        return True

    def isatty(self) -> bool:
        """Return whether the descriptor is a terminal."""
        return os.isatty(self._descriptor)

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._descriptor

    def write(self, data: Any) -> int:
        """Hand bytes to the thread; wait until they are written, as far as patience goes."""
        with self._changed:
            if self._is_stuck and len(self._waiting) > _BACKLOG_BYTES:
                self.is_incomplete = True
            elif not self.failure:
                self._waiting += data
                self._wake()
            self._wait()
        return len(data)

    def flush(self) -> None:
        """Wait until everything is written, as far as patience goes."""
        with self._changed:
            self._wait()

    def finish(self) -> None:
        """Give the reader a last chance, then leave out what it has not taken."""
        with self._changed:
            self.patience_s, self._is_stuck = _PATIENCE_S, False
            self._wait()
            self.is_incomplete |= bool(self._waiting)
            self._waiting.clear()

    def _wait(self) -> None:
        while self._waiting and not self.failure and not self._is_stuck:
            self._is_stuck = not self._changed.wait(self.patience_s)

    def _wake(self) -> None:
        if self._thread is None:
            thread = threading.Thread(target=self._work, name="stdout", daemon=True)
            try:
                thread.start()
            except RuntimeError:
                # This user may start no more threads (`ulimit -u`).
                while self._waiting and not self.failure:
                    self._drop(*self._put(bytes(self._waiting[:_CHUNK_BYTES])))
                return
            self._thread = thread
        self._changed.notify_all()

    def _work(self) -> None:
        while not self.failure:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting)  # no time-out: a daemon thread
                chunk = bytes(self._waiting[:_CHUNK_BYTES])
            written = self._put(chunk)
            with self._changed:
                self._drop(*written)
                self._is_stuck = False
                self._changed.notify_all()

    def _put(self, chunk: bytes) -> tuple[int, int]:
        """Return how much could be written, and the error number or 0."""
        try:
            return os.write(self._descriptor, chunk), 0
        except BlockingIOError:
            # Another process has made the terminal or pipe non-blocking.
            select.select([], [self._descriptor], [], _POLL_S)
            return 0, 0
        except OSError as exc:
            return 0, exc.errno or errno.EIO

    def _drop(self, written: int, failure: int) -> None:
        """Forget what is written, or all where nothing more can be."""
        del self._waiting[: None if failure else written]
        self.failure = failure


@contextlib.contextmanager
def buffered() -> Iterator[StdoutBuffer]:
    """Yield the buffer of standard output, that of error beside it; report what was lost."""
    # Python has None where a stream is closed, as after `stepbus run … <&-`, and the next file that
    # is opened would get its descriptor.
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115
    before = sys.stdout, sys.stderr
    # Copies: a run in one process sends what libraries in C print elsewhere.
    output, error = (StdoutBuffer(os.dup(stream.fileno())) for stream in before)
    sys.stdout, sys.stderr = (
        io.TextIOWrapper(buffer, encoding=s.encoding, errors=s.errors, write_through=True)  # type: ignore[type-var]
        for buffer, s in zip((output, error), before, strict=True)
    )
    try:
        yield output
    finally:
        output.finish()
        # A closed pipe is how `head` ends, and there is no user at a closed terminal.
        if output.failure not in {0, errno.EPIPE, errno.EIO}:
            output.is_incomplete = True
            print_error(f"stdout: {os.strerror(output.failure)}; the output is incomplete")
        elif output.is_incomplete:
            print_error("stdout: no process reads it; the output is incomplete")
        error.finish()
        output.is_mute = error.failure == errno.EBADF
        sys.stdout, sys.stderr = before


def hurry() -> None:
    """Wait for readers only so long from now on: a run ends in time though none reads, and well."""
    for stream in (sys.stdout, sys.stderr):
        buffer = getattr(stream, "buffer", None)
        if isinstance(buffer, StdoutBuffer):
            buffer.patience_s, buffer.is_needed = _PATIENCE_S, False
