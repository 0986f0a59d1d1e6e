"""The last half minute of every port, so that a curve is there as soon as it is picked."""

from collections import deque
from collections.abc import Callable, Iterable

import numpy as np

from stepbus_orchestrator.recording import Tail
from stepbus_tools.viewing.stage.curves import Data
from stepbus_tools.viewing.stage.signals import Signal, value_of

_POINTS = 900
"""Of a curve: half a minute."""
_BYTES = 2 * 1024 * 1024
"""Of a port: a type of the user's own may be large."""


class Points:
    """Keeps the newest messages of some ports, one a frame, and reads a signal from them.

    step_ns: returns the length of a step [ns]; 0 while nobody knows it.
    """

    def __init__(self, tail: Tail, topics: Iterable[str], step_ns: Callable[[], int]) -> None:
        self._tail = tail
        self._step_ns = step_ns
        self._kept: dict[str, deque[tuple[int, bytes]]] = {topic: deque() for topic in topics}
        self._picked: Signal | None = None
        self._rows: deque[tuple[int, list[float]]] = deque(maxlen=_POINTS)

    def add(self) -> None:
        """Keep what is new."""
        for topic, kept in self._kept.items():
            newest = self._tail.newest(topic)
            if newest is not None and (not kept or newest[0] > kept[-1][0]):
                kept.append(newest)
                while len(kept) > max(2, min(_POINTS, _BYTES // (len(newest[1]) + 1))):
                    kept.popleft()

    def sample(self, signal: Signal) -> Data:
        """Return a signal before now: times up to 0, shape (T,) [s], and values, shape (T, n)."""
        if signal != self._picked:
            self._picked = signal
            self._rows.clear()
        last = self._rows[-1][0] if self._rows else -1
        for step, data in self._kept.get(signal.topic, ()):
            message = self._tail.decode(signal.topic, data) if step > last else None
            if message is not None:
                self._rows.append((step, value_of(signal, message)))
        steps = np.array([step for step, _ in self._rows], dtype=np.float64)
        values = np.array([row for _, row in self._rows], dtype=np.float64)
        seconds = (steps - steps[-1:].sum()) * (self._step_ns() or 1_000_000_000) * 1e-9
        return seconds, values.reshape(len(steps), len(signal.names))
