"""A WebSocket server that Foxglove and Lichtblick open: on loopback, with a token in its address.

It speaks `foxglove.websocket.v1` and its successor `foxglove.sdk.v1`, which are alike in all that
is used here. The server of foxglove-sdk knows neither tokens nor the older name, which Lichtblick
asks for; the messages and their schemas are its own.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import logging
import secrets
import socket
import struct
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from stepbus_participant import need
from stepbus_tools.viewing.access import (
    LOOPBACK,
    listening,
    new_token,
    only_with,
    shown_host,
)

PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
_MESSAGE = struct.Struct("<BIQ")
"""Opcode 1, subscription, time [ns]; the message follows."""
_TIME = struct.Struct("<BQ")
"""Opcode 2, time [ns]."""
_MOST_LOGS = 1000
_END_S = 0.5
"""How long a client has to say goodbye."""
_PATIENCE_S = 20.0
"""How long a client may leave what it was sent unread."""
_LOG = "Log"

Row = tuple[str, Any, int]
"""Topic, foxglove message, time [ns]."""


@dataclass(kw_only=True)
class _Channel:
    """A topic. newest: time [ns] and message, for who subscribes later; of a log, many."""

    number: int
    about: dict[str, Any]
    newest: deque[tuple[int, bytes]]


@dataclass(kw_only=True)
class _Client:
    """Who is connected. subscriptions: its number of a subscription → the channel.

    pending: channel → the newest messages that it has not been sent.
    """

    socket: Any
    subscriptions: dict[int, int] = field(default_factory=dict)
    pending: dict[int, deque[tuple[int, bytes]]] = field(default_factory=dict)
    texts: list[str] = field(default_factory=list)
    t_ns: int | None = None
    news: asyncio.Event = field(default_factory=asyncio.Event)


class Server:
    """Publishes to whoever is connected, from a thread of its own; `publish` never waits.

    A client that reads slowly gets the newest message of each channel, and one that stops is
    disconnected. address: with the token. arrivals: how many clients have come so far. sessions:
    how often one came when nobody was there. forgets: whether the next session should get nothing
    of what was sent before.
    """

    def __init__(self, name: str, listener: socket.socket, token: str) -> None:
        (websockets,) = need("Foxglove", "websockets.asyncio.server")
        self._serve = websockets.serve
        self._name = name
        self._listener = listener
        self._token = token
        self._session = secrets.token_hex(8)
        self._channels: dict[str, _Channel] = {}
        self._by_number: dict[int, _Channel] = {}
        self._clients: list[_Client] = []
        self._t_ns: int | None = None
        self.arrivals = self.sessions = 0
        self.forgets = False
        host, port = listener.getsockname()[:2]
        self.address = f"ws://{shown_host(host)}:{port}/{token}/"
        self._loop = asyncio.new_event_loop()
        self._over = asyncio.Event()
        self._thread = threading.Thread(target=self._work, name="foxglove", daemon=True)
        self._thread.start()

    @property
    def has_clients(self) -> bool:
        """Return whether anybody is connected."""
        return bool(self._clients)

    def publish(self, t_ns: int, rows: Sequence[Row]) -> None:
        """Send messages and the time [ns] to whoever has subscribed to them."""
        encoded = [
            (topic, type(message), message.encode(), stamp) for topic, message, stamp in rows
        ]
        with contextlib.suppress(RuntimeError):
            # The loop may have ended.
            self._loop.call_soon_threadsafe(self._take, t_ns, encoded)

    def close(self) -> None:
        """Disconnect everybody, whether they read or not."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join(10 * _END_S)

    # --- in the thread --------------------------------------------------------------------

    def _work(self) -> None:
        try:
            self._loop.run_until_complete(self._listen())
        finally:
            self._loop.close()

    async def _listen(self) -> None:
        async with self._serve(
            self._meet,
            sock=self._listener,
            subprotocols=PROTOCOLS,
            process_request=only_with(self._token, lambda *_: None),
            compression=None,
            ping_interval=_PATIENCE_S,
            ping_timeout=_PATIENCE_S,
            logger=_silent(),
        ):
            await self._over.wait()  # no time-out: `close` sets it
            ends = [asyncio.create_task(client.socket.close()) for client in self._clients]
            if ends:
                await asyncio.wait(ends, timeout=_END_S)
            for client in self._clients:
                client.socket.transport.abort()

    def _take(self, t_ns: int, rows: Sequence[tuple[str, Any, bytes, int]]) -> None:
        self._t_ns = t_ns
        for topic, kind, data, stamp in rows:
            channel = self._channels.get(topic) or self._add(topic, kind)
            channel.newest.append((stamp, data))
            for client in self._clients:
                if channel.number in client.subscriptions.values():
                    empty = deque[tuple[int, bytes]](maxlen=channel.newest.maxlen)
                    client.pending.setdefault(channel.number, empty).append((stamp, data))
        for client in self._clients:
            client.t_ns = t_ns
            client.news.set()

    def _forget(self) -> None:
        self._t_ns = None
        for channel in self._channels.values():
            channel.newest.clear()

    def _add(self, topic: str, kind: Any) -> _Channel:
        schema = kind.get_schema()
        number = len(self._channels) + 1
        about = {
            "id": number,
            "topic": topic,
            "encoding": "protobuf",
            "schemaName": schema.name,
            "schema": base64.b64encode(schema.data).decode(),
            "schemaEncoding": "protobuf",
        }
        most = _MOST_LOGS if kind.__name__ == _LOG else 1
        channel = _Channel(number=number, about=about, newest=deque(maxlen=most))
        self._channels[topic] = self._by_number[number] = channel
        for client in self._clients:
            client.texts.append(_advertise([channel]))
        return channel

    async def _meet(self, connection: Any) -> None:
        client = _Client(socket=connection, t_ns=self._t_ns)
        info = {
            "op": "serverInfo",
            "name": self._name,
            "capabilities": ["time"],
            "supportedEncodings": [],
            "metadata": {},
            "sessionId": self._session,
        }
        client.texts = [json.dumps(info), _advertise(list(self._channels.values()))]
        client.news.set()
        self._clients.append(client)
        self.arrivals += 1
        self.sessions += len(self._clients) == 1
        sender = asyncio.create_task(_send(client))
        try:
            # It ends with the connection.
            async for text in connection:
                self._answer(client, text)
        finally:
            self._clients.remove(client)
            if self.forgets and not self._clients:
                self._forget()
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, _closed()):
                await sender

    def _answer(self, client: _Client, text: object) -> None:
        """Do what a client asks for; what nobody offered is ignored."""
        try:
            asked = json.loads(text) if isinstance(text, str) else {}
            match asked.get("op"):
                case "subscribe":
                    rows = [(int(r["id"]), int(r["channelId"])) for r in asked["subscriptions"]]
                    self._subscribe(client, rows)
                case "unsubscribe":
                    for number in asked["subscriptionIds"]:
                        client.subscriptions.pop(int(number), None)
        except (ValueError, KeyError, TypeError, AttributeError):
            return

    def _subscribe(self, client: _Client, rows: Sequence[tuple[int, int]]) -> None:
        for subscription, number in rows:
            channel = self._by_number.get(number)
            if channel is not None and 0 <= subscription < 1 << 32:
                client.subscriptions[subscription] = number
                client.pending[number] = channel.newest.copy()
        client.news.set()


def open_server(name: str, *, host: str = LOOPBACK, port: int = 0) -> Server:
    """Open a server; port 0: any that is free.

    Raises WiringError for a port that is taken or an address that is not of this machine,
    ExtraMissing without websockets.
    """
    listener = listening(host, port)
    try:
        return Server(name, listener, new_token())
    except BaseException:
        listener.close()
        raise


async def _send(client: _Client) -> None:
    """Send what is new, as fast as a client reads."""
    with contextlib.suppress(_closed()):
        while True:
            await client.news.wait()  # no time-out: its client may be silent
            client.news.clear()
            texts, client.texts = client.texts, []
            for text in texts:
                await client.socket.send(text)
            pending, client.pending = client.pending, {}
            if client.t_ns is not None:
                await client.socket.send(_TIME.pack(2, client.t_ns))
            numbers = {channel: number for number, channel in client.subscriptions.items()}
            for channel, rows in pending.items():
                if channel in numbers:
                    for t_ns, data in rows:
                        await client.socket.send(_MESSAGE.pack(1, numbers[channel], t_ns) + data)


def _advertise(channels: Sequence[_Channel]) -> str:
    return json.dumps({"op": "advertise", "channels": [channel.about for channel in channels]})


def _closed() -> type[Exception]:
    closed: type[Exception] = need("Foxglove", "websockets.exceptions")[0].ConnectionClosed
    return closed


def _silent() -> logging.Logger:
    """Return a logger that says nothing: who does not speak the protocol is refused, no more."""
    logger = logging.getLogger("stepbus.foxglove")
    logger.addHandler(logging.NullHandler())
    logger.propagate = False
    return logger
