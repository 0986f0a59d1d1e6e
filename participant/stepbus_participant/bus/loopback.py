"""A bus in memory: for a run in one process, and for tests of what talks over a `Bus`."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from queue import Empty, SimpleQueue
from typing import Any, Literal, NamedTuple

from .interface import BusError, Clock, Queue, Request


class _Sample(NamedTuple):
    key: str
    payload: bytes
    encoding: str
    attachment: bytes


@dataclass(frozen=True)
class _LoopbackRequest:
    payload: bytes
    replies: Queue

    def reply(self, data: bytes, encoding: str) -> None:
        self.replies.put(data)


@dataclass(frozen=True, eq=False)
class _Declared:
    """What one bus has declared on its network; sink: what to call."""

    bus: LoopbackBus
    role: Literal["subscriber", "receiver", "answerer", "watcher", "alive"]
    key: str
    sink: Callable[..., None] = lambda *_: None


@dataclass(frozen=True, eq=False)
class _Route:
    """Where a publisher's samples go. only: the one bus they reach; without: one they do not."""

    key: str
    sinks: list[Callable[..., None]]
    receivers: list[Callable[..., None]]
    only: LoopbackBus | None
    without: LoopbackBus | None


class LoopbackBus:
    """A `Bus` without a network: samples reach their subscribers in the publisher's own thread.

    peer: any bus of the network to join; default: a new network. make_queue: of what it queues.
    clock: of the network.
    is_leaf: it has a link to `peer` only, so that what it publishes reaches nobody else.
    """

    def __init__(
        self,
        peer: LoopbackBus | None = None,
        make_queue: Callable[[], Queue] = SimpleQueue,
        *,
        clock: Clock = time,
        is_leaf: bool = False,
    ) -> None:
        self.clock: Clock = clock if peer is None else peer.clock
        self.declared: list[_Declared] = [] if peer is None else peer.declared
        self._routes: list[_Route] = [] if peer is None else peer._routes
        self._only = peer if is_leaf else None
        self.queue = make_queue
        self._closed = False

    def publisher(self, key: str, encoding: str, *, remote: bool = False) -> Callable[..., None]:
        """Return a function that publishes bytes; it raises BusError once the bus is closed."""
        # The same list for as long as the network lives, so that a put has nothing to look up.
        sinks: list[Callable[..., None]] = []
        receivers: list[Callable[..., None]] = []
        route = _Route(key, sinks, receivers, self._only, self if remote else None)
        self._routes.append(route)
        self._find_subscribers()

        def put(data: bytes, attachment: bytes = b"") -> None:
            if self._closed:
                raise BusError(f"{key}: the bus is closed")
            content = bytes(data)
            for receive in receivers:
                receive(content)
            for sink in sinks:
                sink(_Sample(key, content, encoding, attachment))

        return put

    def _find_subscribers(self) -> None:
        """Renew who gets what is published on each key, after something was declared."""
        for route in self._routes:
            route.sinks[:] = self._reached("subscriber", route)
            route.receivers[:] = self._reached("receiver", route)

    def _reached(self, role: str, route: _Route) -> list[Callable[..., None]]:
        return [
            row.sink
            for row in self._rows(role, route.key)
            if row.bus is not route.without and route.only in {None, row.bus}
        ]

    def subscribe(self, key: str, sink: Callable[[Any], None]) -> None:
        """Call `sink` with each sample on a key; `*` stands for one part of it."""
        self.declared.append(_Declared(self, "subscriber", key, sink))
        self._find_subscribers()

    def subscribe_content(self, key: str, sink: Callable[[bytes], None]) -> None:
        """Call `sink` with the content of each sample on a key; `*` stands for one part of it."""
        self.declared.append(_Declared(self, "receiver", key, sink))
        self._find_subscribers()

    def payload(self, sample: Any) -> bytes:
        """Return the content of a sample."""
        data: bytes = sample.payload
        return data

    def key(self, sample: Any) -> str:
        """Return the key of a sample."""
        return str(sample.key)

    def encoding(self, sample: Any) -> str:
        """Return the encoding of a sample."""
        return str(sample.encoding)

    def attachment(self, sample: Any) -> bytes:
        """Return the attachment of a sample, empty where it has none."""
        data: bytes = sample.attachment
        return data

    def query(self, key: str, data: bytes, encoding: str, timeout_s: float) -> Iterator[bytes]:
        """Yield the answers to a query as they come, of everybody who answers in time."""
        replies = self.queue()
        deadline = self.clock.monotonic() + timeout_s
        for _ in range(self._call("answerer", key, _LoopbackRequest(data, replies))):
            try:
                yield replies.get(timeout=max(0.0, deadline - self.clock.monotonic()))
            except Empty:
                return

    def answer(self, key: str, sink: Callable[[Request], None]) -> None:
        """Call `sink` with each query on a key."""
        self.declared.append(_Declared(self, "answerer", key, sink))

    def declare_alive(self, key: str) -> None:
        """Be seen alive under a key until the bus closes."""
        self.declared.append(_Declared(self, "alive", key))
        self._call("watcher", key, key, True)

    def watch_alive(self, key: str, sink: Callable[[str, bool], None]) -> None:
        """Call `sink` with (key, alive) now and whenever a participant comes or goes."""
        self.declared.append(_Declared(self, "watcher", key, sink))
        for row in tuple(self.declared):
            if row.role == "alive" and _matches(key, row.key):
                sink(row.key, True)

    def close(self) -> None:
        """Leave the bus; harmless when repeated."""
        self._closed = True
        left = [row for row in self.declared if row.bus is self]
        for row in left:
            self.declared.remove(row)
        self._find_subscribers()
        for row in left:
            if row.role == "alive":
                self._call("watcher", row.key, row.key, False)

    def _call(self, role: str, key: str, *arguments: Any) -> int:
        """Call everybody of a role who has declared a key, and return how many they were."""
        sinks = self._sinks(role, key)
        for sink in sinks:
            sink(*arguments)
        return len(sinks)

    def _sinks(self, role: str, key: str) -> list[Callable[..., None]]:
        return [row.sink for row in self._rows(role, key)]

    def _rows(self, role: str, key: str) -> list[_Declared]:
        return [row for row in self.declared if row.role == role and _matches(row.key, key)]


@lru_cache(maxsize=4096)
def _matches(wanted: str, key: str) -> bool:
    return re.fullmatch(re.escape(wanted).replace(r"\*", "[^/]+"), key) is not None
