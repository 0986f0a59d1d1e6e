"""The bus of a simulated run: one node a process, one link between any two of them.

It behaves as `ZenohBus` does (docs/protocol.md, P2): what is published before a link is up is
lost; a link keeps its order; a put blocks where the buffer of a link to a process that reads
nothing is full; a process that ends loses what it has not sent, and its token goes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from queue import Empty
from typing import Any, Literal, NamedTuple

from stepbus_participant import BusError, Clock, Queue, Request, Sample

from .tape import Knobs
from .world import NS, Process, SimulatedQueue, World

_MESSAGE_BYTES = 800
"""What a message takes of that beside its content [bytes]."""
_Role = Literal["subscriber", "answerer", "watcher"]


class Parcel(NamedTuple):
    """What a link carries: content, how much later [ns], whether others overtake it."""

    data: bytes
    late_ns: int = 0
    is_overtaken: bool = False


@dataclass(eq=False)
class Link:
    """From one node to another.

    up_ns: when it begins to carry. is_cut: what is published meanwhile is lost. delay_ns: of every
    message. held_bytes: what it holds of messages that have not arrived.
    """

    source: Node
    target: Node
    delay_ns: int
    up_ns: int = 0
    is_cut: bool = False
    held_bytes: int = 0
    last_ns: int = 0

    def send(self, parcel: Parcel, act: Callable[[bytes], None]) -> None:
        """Let something happen in the target's process once a parcel has arrived."""
        world = self.source.process.world
        at_ns, taken = world.now_ns + self.delay_ns + parcel.late_ns, 0
        if not parcel.is_overtaken:
            at_ns = self.last_ns = max(self.last_ns, at_ns)
            taken = len(parcel.data) + _MESSAGE_BYTES
        self.held_bytes += taken

        def take() -> None:
            self.held_bytes -= taken
            self.source.let_go_on()
            act(parcel.data)

        world.after(at_ns - world.now_ns, lambda: self.target.process.act(take))


class Network:
    """All nodes of a run, and the links between them; knobs: their delay and buffer.

    late_ns: two processes → how much later the links between them come up. change: returns what a
    link carries in place of a message with a key.
    """

    def __init__(self, world: World, knobs: Knobs) -> None:
        self.world = world
        self.nodes: dict[str, Node] = {}
        self.links: dict[tuple[str, str], Link] = {}
        self.delay_ns = 1000 * knobs.link_us
        self.buffer_bytes = knobs.buffer_bytes
        self.late_ns: dict[frozenset[str], int] = {}
        self._up_ns: dict[frozenset[str], int] = {}
        self.change: Callable[[Link, str, bytes], list[Parcel]] = _unchanged

    def link(self, source: Node, target: Node) -> Link:
        """Return the link from one node to another."""
        key = source.process.name, target.process.name
        link = self.links.get(key)
        if link is None or link.target is not target or link.source is not source:
            pair = frozenset(key)
            up_ns = self._up_ns.setdefault(pair, self.world.now_ns + self.late_ns.get(pair, 0))
            self.links[key] = Link(source, target, self.delay_ns, up_ns)
        return self.links[key]

    def heal_all(self) -> None:
        """Open every connection, and let each message through from now on."""
        for one, other in list(self.links):
            link = self.links[one, other]
            link.up_ns = 0
            if link.is_cut:
                self.connect(one, other, is_up=True)
        self.change = _unchanged
        self.late_ns.clear()

    def connect(self, one: str, other: str, *, is_up: bool) -> bool:
        """Open or close the connection of two processes; return whether there was one."""
        left, right = self.nodes.get(one), self.nodes.get(other)
        if left is None or right is None or not (left.is_open and right.is_open):
            return False
        for here, there in ((left, right), (right, left)):
            self.link(here, there).is_cut = not is_up
            for token in here.tokens:
                there.hear(token, is_alive=is_up)
        return True


class Node:
    """A `Bus`: what one process has declared on the network."""

    def __init__(
        self, network: Network, process: Process, *, is_leaf: bool = False, is_center: bool = False
    ) -> None:
        self.network = network
        self.process = process
        self.is_leaf, self.is_center, self.exchange = is_leaf, is_center, None
        self.declared: list[tuple[_Role, str, Callable[..., None]]] = []
        self.tokens: list[str] = []
        self.is_open = True
        self._is_blocked = False
        network.nodes[process.name] = self
        process.on_end.append(self.close)

    @property
    def clock(self) -> Clock:
        """Return the process's clock."""
        return self.process.clock

    def queue(self) -> Queue:
        """Return a queue that the network fills."""
        return SimulatedQueue(self.process)

    def every(self, period_s: float, call: Callable[[], None]) -> Callable[[], None]:
        """Call a function every so often [s], beside what the process does; return what ends it."""
        world, period_ns = self.process.world, int(period_s * NS)
        is_over = False

        def tick() -> None:
            if not is_over and not self.process.is_dead:
                if not self.process.is_frozen:
                    call()
                world.after(period_ns, tick)

        def end() -> None:
            nonlocal is_over
            is_over = True

        world.after(period_ns, tick)
        return end

    def sinks(self, role: _Role, key: str) -> list[Callable[..., None]]:
        """Return what it has declared in a role for a key."""
        return [
            sink for own, wanted, sink in self.declared if own == role and _matches(wanted, key)
        ]

    def _targets(self, *, remote: bool = False) -> Iterator[Node]:
        for node in list(self.network.nodes.values()):
            if node is self:
                if self.is_open and not remote:
                    yield self
                continue
            has_link = not (self.is_leaf or node.is_leaf) or self.is_center or node.is_center
            if node.is_open and has_link:
                yield node

    def publisher(self, key: str, encoding: str, *, remote: bool = False) -> Callable[..., None]:
        """Return a function that publishes bytes; it blocks where a reader reads nothing."""

        def put(data: bytes, attachment: bytes = b"") -> None:
            self.process.call()
            if self.process.is_dead:
                return
            if not self.is_open:
                raise BusError(f"{key}: the bus is closed")
            for node in list(self._targets(remote=remote)):
                if node.sinks("subscriber", key):
                    take = partial(node.take, key, bytes(attachment), encoding)
                    self._send(node, key, bytes(data), take)

        return put

    def _send(self, node: Node, key: str, data: bytes, act: Callable[[bytes], None]) -> bool:
        """Let a node take a message; return whether it will, as far as this one can tell."""
        if node is self:
            act(data)
            return True
        link = self.network.link(self, node)
        while (
            link.held_bytes > self.network.buffer_bytes
            and node.is_open
            and not self.process.is_dead
        ):
            self._is_blocked = True
            self.process.wait(None)
        self._is_blocked = False
        is_up = not link.is_cut and self.network.world.now_ns >= link.up_ns
        if not (is_up and node.is_open) or self.process.is_dead:
            return False
        for parcel in self.network.change(link, key, data):
            link.send(parcel, act)
        return True

    def let_go_on(self) -> None:
        """Let a put that is blocked look again."""
        if self._is_blocked:
            self.process.wake()

    def take(self, key: str, attachment: bytes, encoding: str, data: bytes) -> None:
        """Hand a sample to the subscribers."""
        for sink in self.sinks("subscriber", key) if self.is_open else ():
            sink(Sample(key, data, attachment, encoding))

    def _declare(self, role: _Role, key: str, sink: Callable[..., None]) -> None:
        self.process.call()
        self.declared.append((role, key, sink))

    def subscribe(self, key: str, sink: Callable[[Any], None]) -> None:
        """Call `sink` with each sample on a key."""
        self._declare("subscriber", key, sink)

    def subscribe_content(self, key: str, sink: Callable[[bytes], None]) -> None:
        """Call `sink` with the content of each sample on a key."""
        self.subscribe(key, lambda sample: sink(sample.payload))

    def query(self, key: str, data: bytes, encoding: str, timeout_s: float) -> Iterator[bytes]:
        """Yield the replies to a query as they arrive, until the time-out."""
        self.process.call()
        replies, asked = self.queue(), 0

        def ask(node: Node, sink: Callable[[Request], None], question: bytes) -> None:
            def reply(answer: bytes, _encoding: str) -> None:
                node._send(self, "reply", bytes(answer), replies.put)

            sink(Request(question, reply))

        for node in self._targets(remote=True):
            for sink in node.sinks("answerer", key):
                asked += self._send(node, key, bytes(data), partial(ask, node, sink))
        until_ns = self.network.world.now_ns + int(timeout_s * NS)
        for _ in range(asked):
            left_s = (until_ns - self.network.world.now_ns) / NS
            try:
                yield replies.get(timeout=max(0.0, left_s))
            except Empty:
                return

    def answer(self, key: str, sink: Callable[[Any], None]) -> None:
        """Call `sink` with each query on a key."""
        self._declare("answerer", key, sink)

    def declare_alive(self, key: str) -> None:
        """Declare a token, which lasts until the node closes."""
        self.process.call()
        self.tokens.append(key)
        self._tell(key, True)

    def _tell(self, key: str, alive: bool) -> None:
        for node in self._targets():
            for sink in node.sinks("watcher", key):
                self._tell_one(node, sink, key, alive)

    def hear(self, token: str, *, is_alive: bool) -> None:
        """Take that a token of another process has come or gone."""

        def tell() -> None:
            for sink in self.sinks("watcher", token) if self.is_open else ():
                sink(token, is_alive)

        self.process.act(tell)

    def _tell_one(
        self, node: Node, sink: Callable[[str, bool], None], key: str, alive: bool
    ) -> None:
        if node is self:
            sink(key, alive)
            return
        # The routing of Zenoh tells of tokens once a link is up; nothing of them is lost.
        link, world = self.network.link(self, node), self.network.world
        at_ns = max(link.up_ns, link.last_ns, world.now_ns) + link.delay_ns

        def tell() -> None:
            if node.is_open:
                sink(key, alive)

        world.after(at_ns - world.now_ns, lambda: node.process.act(tell))

    def watch_alive(self, key: str, sink: Callable[[str, bool], None]) -> None:
        """Call `sink` with (key, alive) now and whenever a token changes."""
        self._declare("watcher", key, sink)
        for node in self._targets():
            for token in node.tokens:
                if _matches(key, token):
                    node._tell_one(self, sink, token, True)

    def close(self) -> None:
        """Leave the network; harmless when repeated."""
        if self.is_open:
            self.is_open = False
            for token in self.tokens:
                self._tell(token, False)
            for node in list(self.network.nodes.values()):
                node.let_go_on()


def _unchanged(_link: Link, _key: str, data: bytes) -> list[Parcel]:
    return [Parcel(data)]


@lru_cache(maxsize=4096)
def _matches(wanted: str, key: str) -> bool:
    return re.fullmatch(re.escape(wanted).replace(r"\*", "[^/]+"), key) is not None
