"""Connections of the legacy remote API.

A client sends one message per cycle, even an empty one, and reads one answer to each. An answer
that is held back therefore holds its client. That is how a trigger waits for its step: its answer
has all that the client streams as it is after the step.
"""

import contextlib
import select
import socket
import struct
import time
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any

from stepbus_coppelia.clients import ApiError, Client, Simulator
from stepbus_coppelia.legacy import functions, wire

PORT = 19997
_MOST_CLIENTS = 64
_MOST_STREAMS = 4096
_CHUNK = 1 << 16
_HEAVY = 4096
"""Streams with more data [bytes] are sent once per step."""
_LAST_ERRORS = 50
_STOPPED, _PAUSED, _ADVANCING = 0, 8, 16
_START, _STOP = b"\0", b"\2"
_GONE = select.EPOLLRDHUP | select.EPOLLHUP | select.EPOLLERR


class _Stream:
    """A command that is run again and again. sent: simulation time [s]; before 0: not yet."""

    def __init__(self, command: wire.Command) -> None:
        self.command = command
        self.sent = -1.0
        self.heavy = False

    def is_due(self, now: float) -> bool:
        """Return whether to run it in a simulation that advances. now: simulation time [s]."""
        passed_ms = (now - self.sent) * 1000.0
        new = self.sent < 0.0 or passed_ms < 0.0
        return new or (
            passed_ms + 1e-6 >= self.command.period and not (self.heavy and not passed_ms)
        )


class _Connection(Client):
    """A client, its streams and what is to be sent to it.

    held: the message that waits for a step or a new state, and its answers. left: it has said so.
    """

    def __init__(self, simulator: Simulator, link: socket.socket, name: str) -> None:
        self.name = name
        self.heard = time.monotonic()
        self.link = link
        self.out = bytearray()
        self.inbox = wire.Inbox()
        self.held: tuple[tuple[int, int], list[wire.Answer]] | None = None
        self.left = False
        self.mask = 0
        self._simulator = simulator
        self._streams: dict[tuple[int, bytes], _Stream] = {}
        self._size = 0
        self._errors: deque[bytes] = deque(maxlen=_LAST_ERRORS)

    def read(self) -> None:
        """Take what has arrived. Raises FrameError at its end, OSError."""
        data = self.link.recv(_CHUNK)
        if not data:
            raise wire.FrameError("has closed its connection")
        self.heard = time.monotonic()
        self.inbox.add(data)

    def serve(self) -> None:
        """Answer what was read, as far as nothing waits and all is sent. Raises FrameError."""
        self._send()
        while not self.held and not self.out and (message := self.inbox.message()):
            self._take(*message)
            self._send()

    def _send(self) -> None:
        if self.out and not self.held:
            with contextlib.suppress(BlockingIOError):
                del self.out[: self.link.send(self.out)]

    def _take(self, message: tuple[int, int], commands: list[wire.Command]) -> None:
        """Run the commands of a message and answer it, unless that has to wait."""
        answers: list[wire.Answer] = []
        self.held = message, answers
        self._size = 0
        waits = False
        for command in commands if not self.left else ():
            key = command.number, command.identity
            self._streams.pop(key, None)
            if command.mode in {wire.STREAMING, wire.STREAMING_SPLIT}:
                self._streams[key] = _Stream(command)
            elif command.mode == wire.DISCONTINUE:
                answers.append(wire.Answer(command))
            else:
                waits |= self._run(command, answers)
        if len(self._streams) > _MOST_STREAMS:
            raise wire.FrameError(f"streams more than {_MOST_STREAMS} commands")
        if not waits:
            self.answer()

    def answer(self) -> None:
        """Answer the message that was held, with all that is streamed."""
        if self.held is None:
            return
        now, state = self._simulator.time, self._simulator.state
        message, answers = self.held
        for key, stream in list(self._streams.items()):
            if state == _STOPPED or stream.is_due(now):
                answers.append(self._call(stream.command))
                stream.sent, stream.heavy = now, len(answers[-1].data) > _HEAVY
                if key[0] == functions.GET_AND_CLEAR and not answers[-1].failed:
                    del self._streams[key]
        self.held, self.waits = None, False
        bits = (state != _STOPPED) | (state == _PAUSED) << 1
        time_ms = round(now * 1000.0) & 0x7FFFFFFF if state != _STOPPED else 0
        self.out += wire.packets(message, time_ms, bits, answers)

    def _run(self, command: wire.Command, answers: list[wire.Answer]) -> bool:
        """Run a command once; return whether its answer has to wait."""
        number, simulator = command.number, self._simulator
        if number == functions.FINISH:
            self.left = True
            simulator.leave(self, "has finished")
            return False
        if number == functions.TRIGGER:
            self.waits = self.level > 0 and bool(simulator.state & _ADVANCING)
            answers.append(wire.Answer(command, failed=not self.waits))
            return self.waits
        if number in {functions.ENABLE, functions.DISABLE}:
            self.level = int(number == functions.ENABLE)
            answers.append(wire.Answer(command))
            return False
        answers.append(self._call(command))
        # Whoever starts or stops it is answered when it has: a trigger may follow at once.
        which = command.identity[:1] if number == functions.RUN_STATE else b""
        return not answers[-1].failed and (
            (which == _START and not simulator.state & _ADVANCING)
            or (which == _STOP and simulator.state != _STOPPED)
        )

    def _call(self, command: wire.Command) -> wire.Answer:
        """Call a function and return the answer. Raises FrameError when that is too long."""

        def call(function: str, args: Sequence[Any]) -> list[Any]:
            return self._simulator.call(self, function, args)

        try:
            if command.number == functions.LAST_ERRORS:
                data = struct.pack("<i", len(self._errors)) + b"".join(self._errors)
                self._errors.clear()
            else:
                data = functions.run(call, command.number, command.identity, command.data)
        except ApiError as exc:
            self._errors.append(str(exc).encode() + b"\0")
            return wire.Answer(command, failed=True)
        self._size += len(data)
        if self._size > wire.MOST_BYTES:
            raise wire.FrameError(f"asks for more than {wire.MOST_BYTES} bytes at once")
        return wire.Answer(command, data)


class LegacyEndpoint:
    """A port for clients of the legacy remote API, on this machine only.

    port: 0 for a free one, as it then says. Raises OSError if the port is taken.
    """

    def __init__(self, simulator: Simulator, port: int = PORT) -> None:
        self._simulator = simulator
        self._listener = socket.create_server(("127.0.0.1", port))
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._connections: dict[int, _Connection] = {}
        # It is readable when any of them is, or when one that was slow to read can be written to.
        self._poll = select.epoll()
        self._poll.register(self._listener, select.EPOLLIN)

    def sockets(self) -> Iterable[Any]:
        """Return what to poll for reading."""
        return [self._poll]

    def receive(self, socket: Any) -> None:
        """Take and answer what has arrived, without blocking."""
        for number, events in self._poll.poll(0):
            connection = self._connections.get(number)
            if connection is None:
                self._accept()
            elif events & select.EPOLLIN:
                self._serve(connection, reads=True)
            elif events & _GONE:
                self._drop(connection, "has closed its connection")
            else:
                self._serve(connection)

    def stepped(self) -> None:
        """Answer who waited."""
        for connection in [c for c in self._connections.values() if c.held]:
            self._serve(connection, held=True)

    def close(self) -> None:
        """Close all connections."""
        for link in [*(c.link for c in self._connections.values()), self._listener]:
            link.close()
        self._poll.close()

    def _accept(self) -> None:
        try:
            link, (host, port) = self._listener.accept()
        except OSError:
            return
        if len(self._connections) >= _MOST_CLIENTS:
            link.close()
            return
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        name = f"client {len(self._simulator.clients) + 1} (legacy, {host}:{port})"
        connection = _Connection(self._simulator, link, name)
        self._connections[link.fileno()] = connection
        self._poll.register(link, select.EPOLLIN)
        self._simulator.join(connection)

    def _serve(self, connection: _Connection, *, reads: bool = False, held: bool = False) -> None:
        """Read from a client, answer what it sent, and send what it can take."""
        try:
            if reads:
                connection.read()
            if held:
                connection.answer()
            connection.serve()
        except (wire.FrameError, OSError) as exc:
            self._drop(connection, exc.strerror or "" if isinstance(exc, OSError) else str(exc))
            return
        if connection.held:
            mask = select.EPOLLRDHUP
        else:
            mask = select.EPOLLOUT | select.EPOLLRDHUP if connection.out else select.EPOLLIN
        if mask != connection.mask:
            self._poll.modify(connection.link, mask)
            connection.mask = mask

    def _drop(self, connection: _Connection, why: str) -> None:
        del self._connections[connection.link.fileno()]
        connection.link.close()
        if not connection.left:
            self._simulator.leave(connection, why)
