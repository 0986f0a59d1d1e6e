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
from stepbus_tools.viewing.access import LOOPBACK, listening, new_token, only_with, shown_host

_PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
_MESSAGE = struct.Struct("<BIQ")
"""Opcode 1, subscription, time [ns]; the message follows."""
_TIME = struct.Struct("<BQ")
"""Opcode 2, time [ns]."""
_MOST_LOGS = 1000
_END_S = 0.5
"""How long a client has to say goodbye."""
_PATIENCE_S = 20.0
"""How long a client may leave what it was sent unread."""

Row = tuple[str, Any, int]
"""Topic, foxglove message, time [ns]."""


@dataclass(kw_only=True)
class _Channel:
    """A topic. newest: number, time [ns] and message; of a log, many. count: messages so far."""

    about: dict[str, Any]
    newest: deque[tuple[int, int, bytes]]
    count: int = 0


@dataclass(kw_only=True)
class _Client:
    """A connection, and what it has been sent.

    told: channels. subscriptions: its number of a subscription → the channel's. sent: that number →
    the number of the last message. news: whether there may be more.
    """

    socket: Any
    told: int = 0
    subscriptions: dict[int, int] = field(default_factory=dict)
    sent: dict[int, int] = field(default_factory=dict)
    news: asyncio.Event = field(default_factory=asyncio.Event)


class Server:
    """Publishes to every client, from a thread of its own; `publish` never waits.

    A client that reads slowly gets the newest message of each channel, and one that stops is
    disconnected. address: with the token. arrivals: how many clients have come so far. sessions:
    how often one came when there was no other. forgets: whether the next session should get nothing
    of what was sent before.
    """

    def __init__(self, name: str, listener: socket.socket, token: str) -> None:
        server, exceptions = need("Foxglove", "websockets.asyncio.server", "websockets.exceptions")
        self._serve, self._closed = server.serve, exceptions.ConnectionClosed
        self._name = name
        self._listener = listener
        self._token = token
        self._session = secrets.token_hex(8)
        # A channel's number is that of its place, from 1 on.
        self._channels: dict[str, _Channel] = {}
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
        """Return whether there is a connection."""
        return bool(self._clients)

    def publish(self, t_ns: int, rows: Sequence[Row]) -> None:
        """Send messages and the time [ns] to every client that has subscribed to them."""
        encoded = [
            (topic, type(message), message.encode(), stamp) for topic, message, stamp in rows
        ]
        with contextlib.suppress(RuntimeError):
            # The loop may have ended.
            self._loop.call_soon_threadsafe(self._keep, t_ns, encoded)

    def close(self) -> None:
        """Disconnect every client, whether it reads or not."""
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
        # A client that does not speak the protocol is refused, no more.
        logger = logging.getLogger("stepbus.foxglove")
        logger.addHandler(logging.NullHandler())
        logger.propagate = False
        async with self._serve(
            self._meet,
            sock=self._listener,
            subprotocols=_PROTOCOLS,
            process_request=only_with(self._token, lambda *_: None),
            compression=None,
            ping_interval=_PATIENCE_S,
            ping_timeout=_PATIENCE_S,
            logger=logger,
        ):
            await self._over.wait()  # no time-out: `close` sets it
            ends = [asyncio.create_task(client.socket.close()) for client in self._clients]
            if ends:
                await asyncio.wait(ends, timeout=_END_S)
            for client in self._clients:
                client.socket.transport.abort()

    def _keep(self, t_ns: int, rows: Sequence[tuple[str, Any, bytes, int]]) -> None:
        """Keep the newest messages, and wake their senders."""
        self._t_ns = t_ns
        for topic, kind, data, stamp in rows:
            channel = self._channels.get(topic) or self._add(topic, kind)
            channel.count += 1
            channel.newest.append((channel.count, stamp, data))
        for client in self._clients:
            client.news.set()

    def _add(self, topic: str, kind: Any) -> _Channel:
        schema = kind.get_schema()
        about = {
            "id": len(self._channels) + 1,
            "topic": topic,
            "encoding": "protobuf",
            "schemaName": schema.name,
            "schema": base64.b64encode(schema.data).decode(),
            "schemaEncoding": "protobuf",
        }
        most = _MOST_LOGS if kind.__name__ == "Log" else 1
        channel = self._channels[topic] = _Channel(about=about, newest=deque(maxlen=most))
        return channel

    async def _meet(self, connection: Any) -> None:
        client = _Client(socket=connection)
        client.news.set()
        self._clients.append(client)
        self.arrivals += 1
        self.sessions += len(self._clients) == 1
        sender = asyncio.create_task(self._send(client))
        try:
            # It ends with the connection.
            async for text in connection:
                self._answer(client, text)
        finally:
            self._clients.remove(client)
            if self.forgets and not self._clients:
                self._t_ns = None
                for channel in self._channels.values():
                    channel.newest.clear()
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, self._closed):
                await sender

    async def _send(self, client: _Client) -> None:
        """Send what is new, as fast as a client reads."""
        info = {
            "op": "serverInfo",
            "name": self._name,
            "capabilities": ["time"],
            "supportedEncodings": [],
            "metadata": {},
            "sessionId": self._session,
        }
        await client.socket.send(json.dumps(info))
        while True:
            await client.news.wait()  # no time-out: its client may be silent
            client.news.clear()
            channels = list(self._channels.values())
            fresh = [channel.about for channel in channels[client.told :]]
            if fresh:
                await client.socket.send(json.dumps({"op": "advertise", "channels": fresh}))
            client.told = len(channels)
            if self._t_ns is not None:
                await client.socket.send(_TIME.pack(2, self._t_ns))
            for number, place in list(client.subscriptions.items()):
                for count, t_ns, data in list(channels[place - 1].newest):
                    if count > client.sent.get(number, 0):
                        client.sent[number] = count
                        await client.socket.send(_MESSAGE.pack(1, number, t_ns) + data)

    def _answer(self, client: _Client, text: object) -> None:
        """Do what a client asks for; a request that makes no sense is ignored."""
        with contextlib.suppress(ValueError, KeyError, TypeError, AttributeError):
            asked = json.loads(text) if isinstance(text, str) else {}
            match asked.get("op"):
                case "subscribe":
                    rows = [(int(r["id"]), int(r["channelId"])) for r in asked["subscriptions"]]
                    for number, place in rows:
                        if 0 < place <= client.told and 0 <= number < 1 << 32:
                            client.subscriptions[number] = place
                            client.sent.pop(number, None)
                    client.news.set()
                case "unsubscribe":
                    for number in asked["subscriptionIds"]:
                        client.subscriptions.pop(int(number), None)


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
