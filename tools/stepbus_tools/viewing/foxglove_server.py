"""A WebSocket server that Foxglove and Lichtblick open: on loopback, with a token in its address.

It speaks `foxglove.websocket.v1` and its successor `foxglove.sdk.v1`, which are alike in all that
is used here. The server of foxglove-sdk knows neither tokens nor the older name, which Lichtblick
asks for; the messages and their schemas are its own.
"""

from __future__ import annotations

import base64
import contextlib
import json
import logging
import secrets
import socket
import struct
import threading
from collections import deque
from collections.abc import Iterator, Sequence
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
_PATIENCE_S = 20
"""How long a client may leave what it was sent unread."""

Row = tuple[str, Any, int]
"""Topic, foxglove message, time [ns]."""


@dataclass(kw_only=True)
class _Channel:
    """A topic. newest: number, time [ns] and message; of a log, many. count: messages so far."""

    about: dict[str, Any]
    newest: deque[tuple[int, int, bytes]]
    count: int = 0


@dataclass(kw_only=True, eq=False)
class _Client:
    """A connection, and what it has been sent.

    told: channels. t_ns: the time [ns]. subscriptions: its number of a subscription → the
    channel's. sent: that number → the number of the last message.
    """

    socket: Any
    told: int = 0
    t_ns: int | None = None
    subscriptions: dict[int, int] = field(default_factory=dict)
    sent: dict[int, int] = field(default_factory=dict)


class Server:
    """Publishes to every client, each from a thread of its own; `publish` waits for none.

    A client that reads slowly gets the newest message of each channel, and one that stops is
    disconnected. address: with the token. arrivals: how many clients have come so far. sessions:
    how often one came when there was no other. forgets: whether the next session should get nothing
    of what was sent before.
    """

    def __init__(self, name: str, listener: socket.socket, token: str) -> None:
        server, exceptions = need("Foxglove", "websockets.sync.server", "websockets.exceptions")
        self._closed = exceptions.ConnectionClosed
        self._info = {
            "op": "serverInfo",
            "name": name,
            "capabilities": ["time"],
            "supportedEncodings": [],
            "metadata": {},
            "sessionId": secrets.token_hex(8),
        }
        # A channel's number is that of its place, from 1 on.
        self._channels: dict[str, _Channel] = {}
        self._clients: list[_Client] = []
        self._t_ns: int | None = None
        self._news = threading.Condition()
        self.arrivals = self.sessions = 0
        self.forgets = False
        host, port = listener.getsockname()[:2]
        self.address = f"ws://{shown_host(host)}:{port}/{token}/"
        # Its connections have it too: a send that takes longer fails.
        patience = struct.pack("ll", _PATIENCE_S, 0)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, patience)
        # A client that does not speak the protocol is refused, no more.
        logger = logging.getLogger("stepbus.foxglove")
        logger.addHandler(logging.NullHandler())
        logger.propagate = False
        self._server = server.serve(
            self._meet,
            sock=listener,
            subprotocols=_PROTOCOLS,
            process_request=only_with(token, lambda *_: None),
            compression=None,
            ping_interval=_PATIENCE_S,
            ping_timeout=_PATIENCE_S,
            logger=logger,
        )
        # The threads of its connections are daemons because it is one.
        threading.Thread(target=self._server.serve_forever, name="foxglove", daemon=True).start()

    @property
    def has_clients(self) -> bool:
        """Return whether there is a connection."""
        return bool(self._clients)

    def publish(self, t_ns: int, rows: Sequence[Row]) -> None:
        """Send messages and the time [ns] to every client that has subscribed to them."""
        with self._news:
            self._t_ns = t_ns
            for topic, message, stamp in rows:
                channel = self._channels.get(topic) or self._add(topic, type(message))
                channel.count += 1
                channel.newest.append((channel.count, stamp, message.encode()))
            self._news.notify_all()

    def close(self) -> None:
        """Disconnect every client, whether it reads or not."""
        self._server.shutdown()
        with self._news, contextlib.suppress(OSError):
            for client in self._clients:
                client.socket.socket.shutdown(socket.SHUT_RDWR)

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

    # --- in the threads of connections ----------------------------------------------------

    def _meet(self, connection: Any) -> None:
        client = _Client(socket=connection)
        with self._news:
            self._clients.append(client)
            self.arrivals += 1
            self.sessions += len(self._clients) == 1
        threading.Thread(target=self._send, args=(client,), daemon=True).start()
        try:
            # It ends with the connection.
            for text in connection:
                with self._news:
                    _answer(client, text)
                    self._news.notify_all()
        finally:
            with self._news:
                self._clients.remove(client)
                if self.forgets and not self._clients:
                    self._t_ns = None
                    for channel in self._channels.values():
                        channel.newest.clear()
                self._news.notify_all()

    def _send(self, client: _Client) -> None:
        """Send what is new, as fast as a client reads."""
        with contextlib.suppress(self._closed, OSError):
            client.socket.send(json.dumps(self._info))
            while client in self._clients:
                with self._news:
                    frames = list(self._fresh(client))
                    if not frames and client in self._clients:
                        self._news.wait()  # no time-out: its client may be silent
                for frame in frames:
                    client.socket.send(frame)

    def _fresh(self, client: _Client) -> Iterator[str | bytes]:
        """Yield what a client has not been sent: channels, the time, the newest messages."""
        channels = list(self._channels.values())
        if fresh := [channel.about for channel in channels[client.told :]]:
            yield json.dumps({"op": "advertise", "channels": fresh})
        client.told = len(channels)
        if self._t_ns is not None and self._t_ns != client.t_ns:
            client.t_ns = self._t_ns
            yield _TIME.pack(2, self._t_ns)
        for number, place in client.subscriptions.items():
            for count, t_ns, data in channels[place - 1].newest:
                if count > client.sent.get(number, 0):
                    client.sent[number] = count
                    yield _MESSAGE.pack(1, number, t_ns) + data


def _answer(client: _Client, text: object) -> None:
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
