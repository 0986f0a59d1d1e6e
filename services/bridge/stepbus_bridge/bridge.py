"""The bridge: a participant, and the program behind it, which reads descriptor 3 and writes 4.

OutputError (of stepbus)
└─ BridgeError      the program ended or gave an invalid answer
"""

import fcntl
import os
import select
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from stepbus_participant import Config, OutputError, Participant, last_lines
from stepbus_schemas import Description, Types, WiringError, json_schema, not_null

VARIABLE = "STEPBUS_BRIDGE"
MOST_BYTES = 16 << 20
"""Longest message of a program."""

_READS, _WRITES = 3, 4
_LOWEST_FREE = 10
_CHUNK = 1 << 16
_REST_S = 1.0
"""Once a message has started, the rest must follow within this [s]."""
_POLL_EVERY = 16
_END_WAIT_S = 0.5
_POLL_S = 0.005
_LONGEST_NAME = 80
_OWN_LOG = Path("/proc/self/fd/2")
"""Our log, which the program prints to as well."""
_SHOWN = 60


class BridgeError(OutputError):
    """The program ended or gave an invalid answer; the message names it."""


Framing = Callable[[bytes | bytearray], int]
"""The start of a message → the length of the message; -1: not yet known."""


class Program:
    """A running program and its two pipes, over which complete messages go.

    It stays in the bridge's process group, which the orchestrator, or its reaper, kills as a
    whole; and it sees the end of descriptor 3 when the bridge dies.

    argv: the path of an executable, and its arguments. form: value of STEPBUS_BRIDGE. failed:
    whether it has broken the rules. Raises WiringError when it cannot be executed, BridgeError when
    an exchange fails.
    """

    def __init__(self, argv: Sequence[str], form: str, framing: Framing) -> None:
        name = " ".join([Path(argv[0]).name, *argv[1:]])
        self._name = name if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]}…"
        self._length_of = framing
        theirs, self._to = _pipe()
        self._from, answers = _pipe()
        try:
            self.pid = _spawn(argv, form, theirs, answers)
        except OSError as exc:
            os.close(self._to)
            os.close(self._from)
            raise WiringError(f"cannot start {argv[0]}: {exc.strerror}") from exc
        finally:
            os.close(theirs)
            os.close(answers)
        self.exit_code: int | None = None
        self.failed = False
        self._asked = 0
        self._open = True
        self._poll = select.poll()
        self._poll.register(self._from, select.POLLIN)

    def __str__(self) -> str:
        return f"{self._name} (pid {self.pid})"

    # --- messages ----------------------------------------------------------------------------

    def ask(self, data: bytes | bytearray) -> bytes | bytearray:
        """Send a message and return the program's answer."""
        # A poll costs as much as a write; what this one misses, a later one finds.
        self._asked += 1
        if self._asked % _POLL_EVERY == 1 and self.has_written():
            unasked = self._read()
            if unasked:
                raise self.wrong(
                    f"wrote {show(unasked)} without being asked; write exactly one answer per "
                    "message"
                )
            raise self._gone()
        self.send(data)
        return self.receive()

    def send(self, data: bytes | bytearray) -> None:
        """Send a message."""
        try:
            sent = os.write(self._to, data)
            while sent < len(data):
                sent += os.write(self._to, memoryview(data)[sent:])
        except BrokenPipeError:
            raise self._gone() from None

    def receive(self) -> bytes | bytearray:
        """Return the next message, however long it takes; the orchestrator has the deadline."""
        data = self._read()
        if data and self._length_of(data) == len(data):
            return data
        return self._receive_pieces(data)

    def _receive_pieces(self, chunk: bytes) -> bytearray:
        data = bytearray()
        while chunk:
            data += chunk
            length = self._length_of(data)
            longest = max(length, len(data))
            if longest > MOST_BYTES:
                raise self.wrong(f"wrote a message of {longest} bytes; the limit is {MOST_BYTES}")
            if 0 <= length <= len(data):
                if length < len(data):
                    raise self.wrong(f"wrote {show(data[length:])} after its answer")
                return data
            if not self.has_written(_REST_S):
                raise self.wrong(f"wrote an incomplete message: {self._progress(data)}")
            chunk = self._read()
        raise self._gone(f" after an incomplete message: {self._progress(data)}" if data else "")

    def _progress(self, data: bytes | bytearray) -> str:
        length = self._length_of(data)
        whole = "without its end" if length < 0 else f"of {length}"
        return f"{len(data)} bytes {whole} ({show(data)})"

    def _read(self) -> bytes:
        """Wait until it has written something, and return it; empty: it writes no more."""
        return os.read(self._from, _CHUNK)

    def has_written(self, timeout_s: float = 0.0) -> bool:
        """Return whether data or the end can be read within a time [s]."""
        return bool(self._poll.poll(timeout_s * 1000))

    def wrong(self, what: str) -> BridgeError:
        """Return the error of a program that broke the rules of the bridge."""
        self.failed = True
        return BridgeError(f"{self} {what}")

    # --- its end -----------------------------------------------------------------------------

    def _gone(self, half: str = "") -> BridgeError:
        """Return the error of a program that writes no more."""
        ended = self.how_it_ended()
        output = last_lines(_OWN_LOG)
        tail = f'; its last output: "{output}"' if output else ""
        return self.wrong(f"{ended}{half}{tail}")

    def has_ended(self, *, wait: bool = False) -> bool:
        """Return whether it has ended, and set `exit_code`. wait: until it has."""
        if self.exit_code is None:
            pid, status = os.waitpid(self.pid, 0 if wait else os.WNOHANG)
            if pid:
                self.exit_code = os.waitstatus_to_exitcode(status)
        return self.exit_code is not None

    def how_it_ended(self) -> str:
        """Return in words why it writes no more."""
        deadline = time.monotonic() + _END_WAIT_S
        while not self.has_ended():
            if time.monotonic() > deadline:
                return f"closed descriptor {_WRITES} but is still running"
            time.sleep(_POLL_S)
        code = self.exit_code or 0
        if code < 0:
            return f"was killed by {signal.Signals(-code).name}"
        return f"exited with code {code}"

    def stop(self) -> None:
        """Close descriptor 3."""
        if self._open:
            self._open = False
            os.close(self._to)


# --- the participant -------------------------------------------------------------------------


Described = Mapping[str, Description]
"""Output → its description, as the scenario gives it."""


class Bridge(Participant):
    """Owns the program and describes its outputs.

    Raises WiringError if the program does not exist.
    """

    def __init__(
        self, config: Config, argv: Sequence[str], form: str, describe: Described, framing: Framing
    ) -> None:
        super().__init__(config)
        self._described = _descriptions(config, describe)
        self.program = Program(argv, form, framing)

    def close(self) -> None:
        """Tell the program that the run is over."""
        self.program.stop()

    def await_end(self) -> str:
        """Wait for the program's end; return an error message about its exit code, or ''."""
        # The orchestrator kills it, and us, if that lasts.
        self.program.has_ended(wait=True)
        if not self.program.exit_code or self.program.failed:
            return ""
        return f"{self.config.name}: {self.program} {self.program.how_it_ended()} after the stop"


def _descriptions(config: Config, given: Described) -> dict[str, Description]:
    """Return the descriptions that are known before the program describes its outputs.

    An output with joints that is not described is like the first input with joints.
    """
    types = config.types
    inputs = (name for name, port in config.inputs.items() if _has_joints(port.type, types))
    first = next(inputs, None)
    like_first = {
        name: Description(like=first)
        for name, port in config.outputs.items()
        if first is not None and _has_joints(port.type, types)
    }
    return {**like_first, **given}


def _has_joints(type_name: str, types: Types) -> bool:
    """Return whether a message type has a vector with one entry per name."""
    fields = json_schema(type_name, types)["properties"].values()
    return any(field.get("shape", not_null(field).get("shape")) == ["n"] for field in fields)


# --- helpers of the program ------------------------------------------------------------------


def show(data: bytes | bytearray) -> str:
    """Return the quoted start of a program's output, for an error message."""
    text = bytes(data[:_SHOWN]).decode(errors="backslashreplace")
    return repr(text) + ("…" if len(data) > _SHOWN else "")


def _pipe() -> tuple[int, int]:
    """Return a pipe with both ends above the descriptors that the program expects."""
    ends = os.pipe()
    high = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, _LOWEST_FREE) for end in ends]
    for end in ends:
        os.close(end)
    return high[0], high[1]


def _spawn(argv: Sequence[str], form: str, reads: int, writes: int) -> int:
    actions: list[tuple[int, ...] | tuple[int, int, str, int, int]] = [
        (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
        (os.POSIX_SPAWN_DUP2, reads, _READS),
        (os.POSIX_SPAWN_DUP2, writes, _WRITES),
    ]
    # Not subprocess: it cannot place descriptors without running Python between fork and exec,
    # which is not safe beside Zenoh's threads.
    return os.posix_spawn(
        argv[0],
        list(argv),
        {**os.environ, VARIABLE: form},
        file_actions=actions,
        # Python ignores these two, which a program would inherit.
        setsigdef=[signal.SIGPIPE, signal.SIGXFSZ],
    )
