"""A bus in memory: for a run in one process, and for tests of what talks over a `Bus`."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from queue import Empty, SimpleQueue
from typing import Any, Literal

from stepbus_schemas import Envelope

from . import BusError, Clock, Queue, Request, Sample

_Role = Literal["subscriber", "receiver", "answerer", "watcher", "alive"]


@dataclass(frozen=True, eq=False)
class _Declared:
    """What one bus has declared on its network; sink: what to call."""

    bus: LoopbackBus
    role: _Role
    key: str
    sink: Callable[..., None]


@dataclass(frozen=True, eq=False)
class _Publisher:
    """A key that one bus publishes on, and who takes it; a put has nothing to look up.

    without: a bus that does not. only: one that alone does; default: all.
    """

    bus: LoopbackBus
    key: str
    without: LoopbackBus | None
    only: LoopbackBus | None
    receivers: list[_Declared]
    subscribers: list[_Declared]

    def reach(self, row: _Declared) -> None:
        """Have one more take it, after all others, if it wants to."""
        is_linked = row.bus is not self.without and self.only in {None, row.bus}
        if is_linked and _matches(row.key, self.key):
            if row.role == "receiver":
                self.receivers.append(row)
            elif row.role == "subscriber":
                self.subscribers.append(row)

    def forget(self, bus: LoopbackBus) -> None:
        """Have none of a bus take it any more."""
        for rows in (self.receivers, self.subscribers):
            rows[:] = [row for row in rows if row.bus is not bus]


class LoopbackBus:
    """A `Bus` without a network: samples reach their subscribers in the publisher's own thread.

    peer: any bus of the network to join; default: a new network. make_queue: of what it queues.
    clock: of the network.
    is_leaf: it has a link to `peer` only, so that what it publishes reaches no other.
    exchange: of the participants that hand their outputs to each other without it.
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
        self.queue = make_queue
        self._declared: list[_Declared] = [] if peer is None else peer._declared
        self._publishers: list[_Publisher] = [] if peer is None else peer._publishers
        self._only = peer if is_leaf else None
        self.exchange: Any = None if peer is None else peer.exchange
        self._closed = False

    def every(self, _period_s: float, _call: Callable[[], None]) -> Callable[[], None]:
        """Call nothing: no put of this bus blocks, so that nobody has to watch it."""
        return lambda: None

    def publisher(self, key: str, encoding: str, *, remote: bool = False) -> Callable[..., None]:
        """Return a function that publishes bytes, or an envelope as it is.

        It raises BusError once the bus is closed.
        """
        receivers: list[_Declared] = []
        subscribers: list[_Declared] = []

        def put(data: Any, attachment: bytes = b"") -> None:
            if self._closed:
                raise BusError(f"{key}: the bus is closed")
            content: Any = data if isinstance(data, Envelope) else bytes(data)
            for row in receivers:
                row.sink(content)
            for row in subscribers:
                row.sink(Sample(key, content, attachment, encoding))

        without = self if remote else None
        made = _Publisher(self, key, without, self._only, receivers, subscribers)
        for row in self._declared:
            made.reach(row)
        self._publishers.append(made)
        return put

    def subscribe(self, key: str, sink: Callable[[Sample], None]) -> None:
        """Call `sink` with each sample on a key; `*` matches one part of it."""
        self._declare("subscriber", key, sink)

    def subscribe_content(self, key: str, sink: Callable[[bytes], None]) -> None:
        """Call `sink` with the content of each sample on a key."""
        self._declare("receiver", key, sink)

    def query(self, key: str, data: bytes, encoding: str, timeout_s: float) -> Iterator[bytes]:
        """Yield the replies to a query as they arrive, until the time-out."""
        replies = self.queue()
        deadline = self.clock.monotonic() + timeout_s
        for _ in range(
            self._call("answerer", key, Request(data, lambda reply, _encoding: replies.put(reply)))
        ):
            try:
                yield replies.get(timeout=max(0.0, deadline - self.clock.monotonic()))
            except Empty:
                return

    def answer(self, key: str, sink: Callable[[Request], None]) -> None:
        """Call `sink` with each query on a key."""
        self._declare("answerer", key, sink)

    def declare_alive(self, key: str) -> None:
        """Be seen alive under a key until the bus closes."""
        self._declare("alive", key, lambda: None)
        self._call("watcher", key, key, True)

    def watch_alive(self, key: str, sink: Callable[[str, bool], None]) -> None:
        """Call `sink` with (key, alive) now and whenever a participant comes or goes."""
        self._declare("watcher", key, sink)
        for row in tuple(self._declared):
            if row.role == "alive" and _matches(key, row.key):
                sink(row.key, True)

    def close(self) -> None:
        """Leave the bus; harmless when repeated."""
        self._closed = True
        left = [row for row in self._declared if row.bus is self]
        self._declared[:] = [row for row in self._declared if row.bus is not self]
        self._publishers[:] = [row for row in self._publishers if row.bus is not self]
        for publisher in self._publishers:
            publisher.forget(self)
        for row in left:
            if row.role == "alive":
                self._call("watcher", row.key, row.key, False)

    def _declare(self, role: _Role, key: str, sink: Callable[..., None]) -> None:
        row = _Declared(self, role, key, sink)
        self._declared.append(row)
        for publisher in self._publishers:
            publisher.reach(row)

    def _call(self, role: _Role, key: str, *arguments: Any) -> int:
        """Call each sink of a role that is declared for a key; return how many they are."""
        rows = [row for row in self._declared if row.role == role and _matches(row.key, key)]
        for row in rows:
            row.sink(*arguments)
        return len(rows)


@lru_cache(maxsize=4096)
def _matches(wanted: str, key: str) -> bool:
    return re.fullmatch(re.escape(wanted).replace(r"\*", "[^/]+"), key) is not None
