"""Connections of the legacy remote API.

A client sends a message per cycle, if an empty one, and reads one answer to each: to hold that
back is to hold the client. So it waits for the step that it triggers, and gets, with the answer,
all that it streams as that is after the step.
"""

import contextlib
import functools
import select
import socket
from collections import deque
from collections.abc import Iterable
from typing import Any

from stepbus_coppelia.clients import ApiError, Client, Simulator
from stepbus_coppelia.legacy import functions, wire

_MOST_CLIENTS, _MOST_STREAMS = 64, 4096
_CHUNK, _HEAVY = 1 << 16, 4096
"""Most to read at once; what a stream may send more than once in a step [bytes]."""
_STOPPED, _PAUSED, _ADVANCING = 0, 8, 16


class _Connection(Client):
    """A client, its streams and what is to be sent to it. held: the message not yet answered."""

    def __init__(self, simulator: Simulator, link: socket.socket, name: str) -> None:
        super().__init__(name)
        self.link = link
        self.out = bytearray()
        self.held: wire.Origin | None = None
        self.has_finished = False
        self._simulator = simulator
        self._inbox = wire.Inbox()
        self._answers: list[wire.Command] = []
        # the command, when it was last sent [s], before 0: not yet, and whether it is heavy
        self._streams: dict[tuple[int, bytes], tuple[wire.Command, float, bool]] = {}
        self._room = wire.MOST_BYTES
        self._errors: deque[bytes] = deque(maxlen=50)

    def read(self) -> None:
        """Take what has arrived. Raises FrameError at its end, OSError."""
        data = self.link.recv(_CHUNK)
        if not data:
            raise wire.FrameError("has closed its connection")
        # It sends a long message in pieces, each after word of the last.
        self.link.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
        self._inbox.bytes += data

    def serve(self) -> None:
        """Answer what was read, while nothing waits and all can be sent. Raises FrameError."""
        self._send()
        while not self.held and not self.out and (message := self._inbox.message()):
            self.held, commands = message
            waits = [self._run(command) for command in commands if not self.has_finished]
            if not any(waits):
                self.answer()

    def answer(self) -> None:
        """Answer the message that was held, with what is streamed. Raises FrameError, OSError."""
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
            if key[0] == functions.GET_AND_CLEAR and not answer.failed:
                del self._streams[key]
        bits = (state != _STOPPED) | (state == _PAUSED) << 1
        time_ms = round(now * 1000.0) & 0x7FFFFFFF if state != _STOPPED else 0
        self.out += wire.packets(self.held or (0, 0), time_ms, bits, self._answers)
        self.held, self.waits, self._answers, self._room = None, False, [], wire.MOST_BYTES
        self._send()

    def _send(self) -> None:
        if self.out:
            with contextlib.suppress(BlockingIOError):
                del self.out[: self.link.send(self.out)]

    def _run(self, command: wire.Command) -> bool:
        """Take a command; return whether its answer has to wait."""
        key = command.number, command.name
        self._streams.pop(key, None)
        if command.mode in {wire.STREAMING, wire.STREAMING_SPLIT}:
            self._streams[key] = command, -1.0, False
            if len(self._streams) > _MOST_STREAMS:
                raise wire.FrameError(f"streams more than {_MOST_STREAMS} commands")
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

    def _call(self, command: wire.Command) -> wire.Command:
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
        elif command.mode != wire.DISCONTINUE:
            try:
                call = functools.partial(self._simulator.call, self)
                data = functions.run(call, number, command.name, command.data)
            except ApiError as exc:
                self._errors.append(str(exc).encode() + b"\0")
                failed = True
        self._room -= len(data)
        if self._room < 0:
            raise wire.FrameError(f"asks for more than {wire.MOST_BYTES} bytes at once")
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
        except (wire.FrameError, OSError) as exc:
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
