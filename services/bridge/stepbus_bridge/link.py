"""Whole messages over the two pipes, and what can be wrong with them."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from stepbus_participant import HOST, last_error

from .errors import BridgeError
from .program import Program

MOST_BYTES = 16 << 20
"""Longest message of a program."""

# What is left of a message that has begun has to follow within this [s].
_REST_S = 1.0
_LOOK_EVERY = 16

# Our log, where the program's prints go too.
_OWN_LOG = Path("/proc/self/fd/2")
_SHOWN = 60


class Framing(Protocol):
    """Where one message ends."""

    def length(self, data: bytes | bytearray) -> int:
        """Return the length of the message at the beginning of `data`; -1: not yet known."""
        ...

    def partly(self, data: bytes | bytearray) -> str:
        """Return in words how much of a message `data` is."""
        ...


class Line:
    """One line, as of JSON."""

    def length(self, data: bytes | bytearray) -> int:
        """See `Framing`."""
        return data.find(b"\n") + 1 or -1

    def partly(self, data: bytes | bytearray) -> str:
        """See `Framing`."""
        return f"{len(data)} bytes without an end of line ({show(data)})"


class Prefixed:
    """An unsigned 32-bit little-endian length, then as many bytes."""

    def length(self, data: bytes | bytearray) -> int:
        """See `Framing`."""
        return 4 + int.from_bytes(data[:4], "little") if len(data) >= 4 else -1

    def partly(self, data: bytes | bytearray) -> str:
        """See `Framing`."""
        total = self.length(data)
        return f"{len(data)} of {total} bytes" if total > 0 else f"{len(data)} of at least 4 bytes"


class Block:
    """Always the same number of float64; `count` may be changed between two messages."""

    def __init__(self, count: int) -> None:
        self.count = count

    def length(self, data: bytes | bytearray) -> int:
        """See `Framing`."""
        return 8 * self.count

    def partly(self, data: bytes | bytearray) -> str:
        """See `Framing`."""
        return f"{len(data)} of {8 * self.count} bytes ({self.count} numbers)"


class Link:
    """Asks a program and takes its answers; raises BridgeError for all that goes wrong.

    failed: whether anything has.
    """

    def __init__(self, program: Program, framing: Framing) -> None:
        self.program = program
        self.failed = False
        self._asked = 0
        self._framing = framing

    def ask(self, data: bytes | bytearray) -> bytes | bytearray:
        """Send a message and return the program's answer."""
        # A poll costs as much as a write, and what was not polled for stays.
        self._asked += 1
        if self._asked % _LOOK_EVERY == 1 and self.program.has_written():
            self._refuse_unasked()
        self.send(data)
        return self.receive()

    def send(self, data: bytes | bytearray) -> None:
        """Send a message."""
        try:
            self.program.write(data)
        except BrokenPipeError:
            raise self.gone() from None

    def receive(self) -> bytes | bytearray:
        """Return the next message, however long it takes; its step has a deadline elsewhere."""
        data = self.program.read()
        if data and self._framing.length(data) == len(data):
            return data
        return self._receive_pieces(data)

    def _receive_pieces(self, chunk: bytes) -> bytearray:
        data = bytearray()
        while chunk:
            data += chunk
            length = self._framing.length(data)
            self._check_length(max(length, len(data)))
            if 0 <= length <= len(data):
                if length < len(data):
                    raise self.wrong(f"wrote {show(data[length:])} behind its answer")
                return data
            if not self.program.has_written(_REST_S):
                raise self.wrong(f"wrote half a message, {self._framing.partly(data)}")
            chunk = self.program.read()
        raise self.gone(f", half a message left: {self._framing.partly(data)}" if data else "")

    def _check_length(self, length: int) -> None:
        if length > MOST_BYTES:
            raise self.wrong(f"wrote a message of {length} bytes; at most {MOST_BYTES} are taken")

    def _refuse_unasked(self) -> None:
        data = self.program.read()
        if data:
            raise self.wrong(f"wrote {show(data)} without being asked; one answer to each message")
        raise self.gone()

    def gone(self, half: str = "") -> BridgeError:
        """Return the error of a program from which nothing comes any more."""
        ended = self.program.how_it_ended()
        host = HOST.get()
        error = last_error(_OWN_LOG if host is None or host.log is None else host.log)
        tail = f'; its last error: "{error}"' if error else ""
        return self.wrong(f"{ended}{half}{tail}")

    def wrong(self, what: str) -> BridgeError:
        """Return the error of a program that wrote something it must not."""
        self.failed = True
        return BridgeError(f"{self.program} {what}")


def show(data: bytes | bytearray) -> str:
    """Return the beginning of what a program wrote, for a message."""
    text = bytes(data[:_SHOWN]).decode(errors="backslashreplace")
    return repr(text) + ("…" if len(data) > _SHOWN else "")
