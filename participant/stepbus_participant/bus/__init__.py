"""The interface between stepbus and the transport that carries its messages."""

import threading
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, Protocol

from stepbus_schemas import RunError


class BusError(RunError, ConnectionError):
    """The bus cannot be opened, or has been closed."""


class Clock(Protocol):
    """The time in which a bus waits; the module `time` is the real one."""

    def monotonic(self) -> float:
        """Return the time since some moment [s]."""

    def monotonic_ns(self) -> int:
        """Return the same [ns]."""

    def time_ns(self) -> int:
        """Return the time since the epoch [ns]; it may jump."""

    def sleep(self, seconds: float, /) -> None:
        """Wait [s]."""


class Queue(Protocol):
    """A queue from the callbacks of a bus to the reader that waits; see `SimpleQueue`."""

    def put(self, item: Any, /) -> None:
        """Add an item, from any thread of the bus."""

    def get(self, block: bool = True, timeout: float | None = None) -> Any:
        """Return the oldest item; raises `queue.Empty` after the time-out [s]."""

    def empty(self) -> bool:
        """Return whether there is no item."""

    def qsize(self) -> int:
        """Return how many items there are."""


class Sample(NamedTuple):
    """What a subscriber gets: its content, and the key relative to the run's key space."""

    key: str
    payload: bytes
    attachment: bytes
    encoding: str


class Request(NamedTuple):
    """A query that waits for its reply; reply: takes its bytes and their encoding, once."""

    payload: bytes
    reply: Callable[[bytes, str], None]


class Bus(Protocol):
    """Publish, subscribe, query, reply, and declare a liveliness token.

    Keys are relative to the run's key space. Callbacks run on a thread of the bus and should
    only put their sample into a queue (P2.7).
    """

    @property
    def clock(self) -> Clock:
        """Return the time in which its queues and queries wait."""

    @property
    def exchange(self) -> Any:
        """Return the `Exchange` of participants in one thread; None: outputs go over the bus."""

    def queue(self) -> Queue:
        """Return a queue for what callbacks get; waiting for it lets the bus work."""

    def every(self, period_s: float, call: Callable[[], None]) -> Callable[[], None]:
        """Call a function every so often [s], where a put can block; return what ends that."""

    def publisher(self, key: str, encoding: str, *, remote: bool = False) -> Callable[..., None]:
        """Return a function that publishes bytes; it also takes `attachment=` bytes.

        remote: subscribers of this bus itself do not get them.
        """

    def subscribe(self, key: str, sink: Callable[[Sample], None]) -> None:
        """Call `sink` with each sample on a key; `*` matches one part of it."""

    def subscribe_content(self, key: str, sink: Callable[[bytes], None]) -> None:
        """Call `sink` with the content of each sample on a key; cheaper than `subscribe`."""

    def query(self, key: str, data: bytes, encoding: str, timeout_s: float) -> Iterable[bytes]:
        """Return the replies to a query as they arrive, until the time-out."""

    def answer(self, key: str, sink: Callable[[Request], None]) -> None:
        """Call `sink` with each query on a key."""

    def declare_alive(self, key: str) -> None:
        """Declare a liveliness token, which lasts until the session closes or the process dies."""

    def watch_alive(self, key: str, sink: Callable[[str, bool], None]) -> None:
        """Call `sink` with (key, alive) now and whenever a liveliness token changes."""

    def close(self) -> None:
        """Close the session; closing it again is harmless."""


_JOIN_S = 1.0


def every_on_a_thread(period_s: float, call: Callable[[], None]) -> Callable[[], None]:
    """Call a function every so often [s], on a thread of its own; return what ends that."""
    is_over = threading.Event()

    def run() -> None:
        while not is_over.wait(period_s):
            call()

    thread = threading.Thread(target=run, name="timer", daemon=True)
    thread.start()

    def end() -> None:
        is_over.set()
        thread.join(_JOIN_S)

    return end
