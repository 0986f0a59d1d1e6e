"""The messages of some ports in pieces, so that a recording of any length takes the same memory."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.recording.earlier import recorded_decoder
from stepbus_schemas import Message

from .columns import columns
from .port import Port
from .source import Row, Source

BATCH_BYTES = 1024 * 1024
"""Of messages in a batch; decoded they take about ten times as much."""


class Batch:
    """The messages of one port in some consecutive steps.

    steps: shape (m,). t: simulation time, shape (m,), [s].
    """

    def __init__(self, port: Port, rows: Sequence[Row]) -> None:
        self._class = port.message_class
        self._data = [row[3] for row in rows]
        self.steps: NDArray[np.int64] = np.array([row[1] for row in rows], dtype=np.int64)
        t_ns = np.array([row[2] for row in rows], dtype=np.int64)
        self.t: NDArray[np.float64] = t_ns * np.float64(1e-9)

    def messages(self) -> Iterator[Message]:
        """Yield its messages; raises MessageError for one that is not of the port's type."""
        return map(recorded_decoder(self._class), self._data)

    def arrays(self, *fields: str) -> dict[str, NDArray[Any] | None]:
        """Return some fields of its messages, as `Port.arrays` does."""
        return columns(self._class, self._data, fields)


def batches(source: Source, ports: Sequence[Port], most_bytes: int) -> Iterator[dict[str, Batch]]:
    """Yield topic → batch in one pass, each batch with whole steps.

    most_bytes: of messages; a batch ends with the step that reaches it.
    """
    found: dict[str, list[Row]] = {port.topic: [] for port in ports}
    places = {number: found[port.topic] for port in ports for number in port.channels}
    size, newest = 0, -1
    for row in source.rows(frozenset(places)):
        if size >= most_bytes and row[1] > newest:
            yield _taken(ports, found)
            size = 0
        places[row[0]].append(row)
        size += len(row[3])
        newest = max(newest, row[1])
    if any(found.values()):
        yield _taken(ports, found)


def _taken(ports: Sequence[Port], found: dict[str, list[Row]]) -> dict[str, Batch]:
    """Return what was found, and empty it."""
    taken = {port.topic: Batch(port, found[port.topic]) for port in ports}
    for rows in found.values():
        rows.clear()
    return taken
