"""The seam between stepbus and whatever carries its messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Protocol

from stepbus_schemas import RunError


class BusError(RunError, ConnectionError):
    """The bus cannot be opened, or has been closed."""


class Request(Protocol):
    """A query that waits for its answer."""

    @property
    def payload(self) -> bytes:
        """Return what was asked."""

    def reply(self, data: bytes, encoding: str) -> None:
        """Answer it, once."""


class Bus(Protocol):
    """Publish, subscribe, ask, answer, and be seen alive.

    Keys are relative to the run's key space. Callbacks run on a thread of the bus and must only
    hand over what they get.
    """

    def publisher(self, key: str, encoding: str) -> Callable[..., None]:
        """Return a function that publishes bytes; it takes `attachment=` bytes too."""

    def subscribe(self, key: str, sink: Callable[[Any], None]) -> None:
        """Call `sink` with each sample on a key; `*` stands for one part of it."""

    def payload(self, sample: Any) -> bytes:
        """Return the content of a sample."""

    def key(self, sample: Any) -> str:
        """Return the key of a sample, relative to the run's key space."""

    def encoding(self, sample: Any) -> str:
        """Return the encoding of a sample."""

    def attachment(self, sample: Any) -> bytes:
        """Return the attachment of a sample, empty where it has none."""

    def query(self, key: str, data: bytes, encoding: str, timeout_s: float) -> Iterable[bytes]:
        """Return the answers to a query as they come, of everybody who answers in time."""

    def answer(self, key: str, sink: Callable[[Request], None]) -> None:
        """Call `sink` with each query on a key."""

    def declare_alive(self, key: str) -> None:
        """Be seen alive under a key until the session closes or the process dies."""

    def watch_alive(self, key: str, sink: Callable[[str, bool], None]) -> None:
        """Call `sink` with (key, alive) now and whenever somebody comes or goes."""

    def close(self) -> None:
        """Leave the bus; harmless when repeated."""
