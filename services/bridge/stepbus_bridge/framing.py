"""Complete messages over the two pipes, and what can be wrong with them.

OutputError (of stepbus)
└─ BridgeError      the program ended, or wrote something that is no answer
"""

from pathlib import Path
from typing import Protocol

from stepbus_bridge.program import Program
from stepbus_participant import HOST, OutputError, last_error

MOST_BYTES = 16 << 20
"""Longest message of a program."""

_REST_S = 1.0
"""Once a message has started, the rest must follow within this [s]."""
_POLL_EVERY = 16
_OWN_LOG = Path("/proc/self/fd/2")
"""Our log, which the program prints to as well."""
_SHOWN = 60


class BridgeError(OutputError):
    """The program ended, or wrote something that is no answer; the text names it."""


class Framing(Protocol):
    """Where one message ends."""

    def length(self, data: bytes | bytearray) -> int:
        """Return the length of the message that `data` starts with; -1: not yet known."""
        ...

    def progress(self, data: bytes | bytearray) -> str:
        """Return in words how much of a message `data` is."""
        ...


class Link:
    """Exchanges messages with a program; raises BridgeError when that fails.

    failed: whether it has failed.
    """

    def __init__(self, program: Program, framing: Framing) -> None:
        self.program = program
        self.failed = False
        self._asked = 0
        self._framing = framing

    def ask(self, data: bytes | bytearray) -> bytes | bytearray:
        """Send a message and return the program's answer."""
        # A poll costs as much as a write; what this one misses, a later one finds.
        self._asked += 1
        if self._asked % _POLL_EVERY == 1 and self.program.has_written():
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
        """Return the next message, however long it takes; the orchestrator has the deadline."""
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
                raise self.wrong(f"wrote half a message, {self._framing.progress(data)}")
            chunk = self.program.read()
        raise self.gone(f", half a message left: {self._framing.progress(data)}" if data else "")

    def _check_length(self, length: int) -> None:
        if length > MOST_BYTES:
            raise self.wrong(f"wrote a message of {length} bytes; at most {MOST_BYTES} are taken")

    def _refuse_unasked(self) -> None:
        data = self.program.read()
        if data:
            raise self.wrong(f"wrote {show(data)} without being asked; one answer to each message")
        raise self.gone()

    def gone(self, half: str = "") -> BridgeError:
        """Return the error of a program that writes no more."""
        ended = self.program.how_it_ended()
        host = HOST.get()
        error = last_error(_OWN_LOG if host is None or host.log is None else host.log)
        tail = f'; its last error: "{error}"' if error else ""
        return self.wrong(f"{ended}{half}{tail}")

    def wrong(self, what: str) -> BridgeError:
        """Return the error of a program that broke the rules of the bridge."""
        self.failed = True
        return BridgeError(f"{self.program} {what}")


def show(data: bytes | bytearray) -> str:
    """Return the beginning of what a program wrote, for a message."""
    text = bytes(data[:_SHOWN]).decode(errors="backslashreplace")
    return repr(text) + ("…" if len(data) > _SHOWN else "")
