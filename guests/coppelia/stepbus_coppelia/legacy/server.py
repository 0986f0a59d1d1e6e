"""Connections of the legacy remote API.

A client sends a message per cycle, if an empty one, and reads one answer to each: to hold that
back is to hold the client. So it waits for the step that it triggers, and gets, with the answer,
all that it streams as that is after the step.

A message goes in packets, each behind u16 1 (it shows the byte order), u16 its size and u16 how
many follow. It is a header and commands; a command is a header, what names it (handles or
zero-terminated texts) and its data. All numbers are little-endian.
"""

import contextlib
import functools
import select
import socket
import struct
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from stepbus_coppelia.clients import ApiError, Client, Simulator
from stepbus_coppelia.legacy import functions

_MOST_CLIENTS, _MOST_STREAMS = 64, 4096
_CHUNK, _HEAVY = 1 << 16, 4096
"""Most to read at once; what a stream may send more than once in a step [bytes]."""
_STOPPED, _PAUSED, _ADVANCING = 0, 8, 16
_MOST_BYTES = 64 << 20
"""Longest message, and most that a client may have sent of commands not yet complete."""
_MOST_COMMANDS, _MOST_PARTS = 4096, 64
"""Most commands in a message, which run before another client is served; most incomplete ones."""
_LONGEST_PACKET, _VERSION = 30000, 11
"""The client reads the size of a packet as a signed number."""
_STREAMING, _STREAMING_SPLIT, _DISCONTINUE = 2, 4, 5
"""Modes of commands."""

_PACKET = struct.Struct("<HHH")
_HEADER = struct.Struct("<HBiiiHB")
"""Checksum (unused), version, number, client's and server's time [ms], scene, state."""
_COMMAND = struct.Struct("<iiHiiHiBB")
"""Size, size of the whole, of the name, place of the data in the whole, number and mode, period
[ms] or longest part, simulation time [ms], whether it failed, unused."""

_Origin = tuple[int, int]
"""Number and client's time [ms] of a message, as its answer repeats them."""


class _FrameError(Exception):
    """A client breaks the rules, or has gone; the text follows its name."""


class _Command(NamedTuple):
    """A command, or the answer to it. period: of a stream [ms]."""

    number: int
    mode: int
    name: bytes
    data: bytes = b""
    period: int = 0
    failed: bool = False


def _packets(origin: _Origin, time_ms: int, state: int, answers: Sequence[_Command]) -> bytes:
    """Return an answer to a message. time_ms: simulation time. state: bits of the header."""
    parts = [_HEADER.pack(0, _VERSION, *origin, time_ms, 0, state)]
    for number, mode, name, data, _, failed in answers:
        size, code = _COMMAND.size + len(name) + len(data), number | mode << 16
        head = _COMMAND.pack(size, size, len(name), 0, code, 0, time_ms, failed, 0)
        parts += head, name, data
    whole, length = b"".join(parts), _LONGEST_PACKET - _PACKET.size
    chunks = [whole[start : start + length] for start in range(0, len(whole), length)]
    rows = zip(chunks, range(len(chunks) - 1, -1, -1), strict=True)
    return b"".join(_PACKET.pack(1, len(chunk), left) + chunk for chunk, left in rows)


class _Connection(Client):
    """A client, its streams and what is to be sent to it. held: the message not yet answered."""

    def __init__(self, simulator: Simulator, link: socket.socket, name: str) -> None:
        super().__init__(name)
        self._simulator, self.link, self.out = simulator, link, bytearray()
        self.held: _Origin | None = None
        self.has_finished = False
        self._arrived, self._whole = bytearray(), bytearray()
        self._parts: dict[tuple[int, bytes], bytearray] = {}
        self._answers: list[_Command] = []
        # the command, when it was last sent [s], before 0: not yet, and whether it is heavy
        self._streams: dict[tuple[int, bytes], tuple[_Command, float, bool]] = {}
        self._room = _MOST_BYTES
        self._errors: deque[bytes] = deque(maxlen=50)

    def read(self) -> None:
        """Take what has arrived. Raises _FrameError at its end, OSError."""
        if not (data := self.link.recv(_CHUNK)):
            raise _FrameError("has closed its connection")
        # It sends a long message in pieces, each after word of the last.
        self.link.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
        self._arrived += data

    def serve(self) -> None:
        """Answer what was read, while nothing waits and all can be sent. Raises _FrameError."""
        self._send()
        while not self.held and not self.out and (message := self._message()):
            self.held, commands = message
            waits = [self._run(command) for command in commands if not self.has_finished]
            if not any(waits):
                self.answer()

    def _message(self) -> tuple[_Origin, list[_Command]] | None:
        """Return the next message, if it is complete. Raises _FrameError."""
        while len(self._arrived) >= _PACKET.size:
            one, size, follow = _PACKET.unpack_from(self._arrived)
            if one != 1:
                raise _FrameError(f"sent a packet that starts with {one} instead of 1")
            end = _PACKET.size + size
            if len(self._arrived) < end:
                break
            self._whole += self._arrived[_PACKET.size : end]
            del self._arrived[:end]
            if len(self._whole) > _MOST_BYTES:
                raise _FrameError(f"sent a message of more than {_MOST_BYTES} bytes")
            if not follow:
                message, self._whole = bytes(self._whole), bytearray()
                if len(message) < _HEADER.size:
                    raise _FrameError(f"sent a message of {len(message)} bytes")
                return _HEADER.unpack_from(message)[2:4], list(self._commands(message))
        return None

    def _commands(self, message: bytes) -> Iterator[_Command]:
        end = _HEADER.size
        for _ in range(_MOST_COMMANDS):
            at, data_at = end, end + _COMMAND.size
            if at == len(message):
                return
            if data_at > len(message):
                raise _FrameError(f"sent a command of {len(message) - at} bytes")
            size, whole, named, place, code, period, *_ = _COMMAND.unpack_from(message, at)
            data_at, end = data_at + named, at + size
            if not data_at <= end <= len(message) or not size <= whole <= _MOST_BYTES:
                raise _FrameError(f"sent a command of {size} of {whole} bytes, {named} its name")
            number, mode = code & 0xFFFF, code >> 16
            name, data = message[data_at - named : data_at], message[data_at:end]
            if size == whole:
                yield _Command(number, mode, name, data, period if mode == _STREAMING else 0)
            elif self._completes(part := (number, name), data, place, whole):
                yield _Command(number, mode, name, bytes(self._parts.pop(part)))
        raise _FrameError(f"sent more than {_MOST_COMMANDS} commands at once")

    def _completes(self, key: tuple[int, bytes], data: bytes, place: int, whole: int) -> bool:
        """Add a part of a command; return whether that was the last."""
        part = self._parts.setdefault(key, bytearray())
        del part[place:]
        part += data
        if sum(map(len, self._parts.values())) > _MOST_BYTES or len(self._parts) > _MOST_PARTS:
            raise _FrameError(f"sent more than {_MOST_BYTES} bytes of incomplete commands")
        return len(part) + len(key[1]) + _COMMAND.size >= whole

    def answer(self) -> None:
        """Answer the message that was held, with what is streamed. Raises _FrameError, OSError."""
        now, state = self._simulator.time, self._simulator.state
        for key, (command, sent, heavy) in list(self._streams.items()):
            passed_ms = (now - sent) * 1000.0
            waits = passed_ms + 1e-6 < command.period or (heavy and not passed_ms)
            if waits and sent >= 0.0 and passed_ms >= 0.0 and state != _STOPPED:
                continue
            # How often it is answered, other than at first, depends on the client's clock.
            self.is_recorded = sent < 0.0
            answer = self._call(command)
            self.is_recorded = True
            self._streams[key] = command, now, len(answer.data) > _HEAVY
        bits = (state != _STOPPED) | (state == _PAUSED) << 1
        time_ms = round(now * 1000.0) & 0x7FFFFFFF if state != _STOPPED else 0
        self.out += _packets(self.held or (0, 0), time_ms, bits, self._answers)
        self.held, self.waits, self._answers, self._room = None, False, [], _MOST_BYTES
        self._send()

    def _send(self) -> None:
        if self.out:
            with contextlib.suppress(BlockingIOError):
                del self.out[: self.link.send(self.out)]

    def _run(self, command: _Command) -> bool:
        """Take a command; return whether its answer has to wait."""
        key = command.number, command.name
        self._streams.pop(key, None)
        if command.mode in {_STREAMING, _STREAMING_SPLIT}:
            self._streams[key] = command, -1.0, False
            if len(self._streams) > _MOST_STREAMS:
                raise _FrameError(f"streams more than {_MOST_STREAMS} commands")
            return False
        if command.number == functions.FINISH:
            self.has_finished = True
            self._streams.clear()
            self._simulator.leave(self, "has finished")
            return False
        if self._call(command).failed or command.number != functions.RUN_STATE:
            return self.waits
        # It is answered when that is done: a trigger may follow at once.
        which, state = command.name[:1], self._simulator.state
        return not state & _ADVANCING if which == b"\0" else which == b"\2" and state != _STOPPED

    def _call(self, command: _Command) -> _Command:
        """Run a command; return the answer, which is kept."""
        number, data, failed = command.number, b"", False
        if number == functions.TRIGGER:
            self.waits = self.level > 0 and bool(self._simulator.state & _ADVANCING)
            failed = not self.waits
        elif number in {functions.ENABLE, functions.DISABLE}:
            self.level = int(number == functions.ENABLE)
        elif number == functions.LAST_ERRORS:
            data = len(self._errors).to_bytes(4, "little") + b"".join(self._errors)
            self._errors.clear()
        elif command.mode != _DISCONTINUE:
            try:
                call = functools.partial(self._simulator.call, self)
                data = functions.run(call, number, command.name, command.data)
            except ApiError as exc:
                self._errors.append(str(exc).encode() + b"\0")
                failed = True
        self._room -= len(data)
        if self._room < 0:
            raise _FrameError(f"asks for more than {_MOST_BYTES} bytes at once")
        self._answers.append(command._replace(data=data, failed=failed))
        return self._answers[-1]


class LegacyEndpoint:
    """A port for clients of the legacy remote API, on this machine only.

    port: 0 for a free one, which it then has. Raises OSError if it is taken.
    """

    def __init__(self, simulator: Simulator, port: int = 19997) -> None:
        self._simulator = simulator
        self._listener = socket.create_server(("127.0.0.1", port))
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._connections: dict[int, _Connection] = {}
        self._count = 0
        # It can be read when any of them can, or when one that was slow to read can be written to.
        self._poll = select.epoll()
        self._poll.register(self._listener, select.EPOLLIN)

    def sockets(self) -> Iterable[Any]:
        """Return what to poll for reading."""
        return [self._poll]

    def receive(self, socket: Any) -> None:
        """Take and answer what has arrived, without blocking."""
        for number, events in self._poll.poll(0):
            if number == self._listener.fileno():
                self._accept()
            elif connection := self._connections.get(number):
                self._serve(connection, reads=events != select.EPOLLOUT)

    def stepped(self) -> None:
        """Answer who waited."""
        for connection in list(self._connections.values()):
            if connection.held:
                self._serve(connection)

    def close(self) -> None:
        """Close all connections."""
        for connection in self._connections.values():
            connection.link.close()
        self._listener.close()
        self._poll.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            link, _ = self._listener.accept()
            if len(self._connections) >= _MOST_CLIENTS:
                link.close()
                return
            link.setblocking(False)
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._count += 1
            connection = _Connection(self._simulator, link, f"client {self._count} (legacy)")
            self._connections[link.fileno()] = connection
            self._poll.register(link, select.EPOLLIN)
            self._simulator.join(connection)

    def _serve(self, connection: _Connection, *, reads: bool = False) -> None:
        """Read from a client or answer what is held, and then all that it has sent."""
        try:
            if reads:
                connection.read()
            elif connection.held:
                connection.answer()
            connection.serve()
        except (_FrameError, OSError) as exc:
            del self._connections[connection.link.fileno()]
            connection.link.close()
            if not connection.has_finished:
                gone = "has lost its connection" if isinstance(exc, OSError) else str(exc)
                self._simulator.leave(connection, gone)
            return
        # Nothing more is taken from who waits or is slow; that it has gone is seen all the same.
        waits = select.EPOLLRDHUP | (select.EPOLLOUT if connection.out else 0)
        busy = connection.held or connection.out
        self._poll.modify(connection.link, waits if busy else select.EPOLLIN)
