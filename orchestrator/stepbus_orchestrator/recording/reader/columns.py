"""The messages of a port as columns: fields are arrays over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import msgpack
import msgspec
import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.recording.layout import recorded_decoder
from stepbus_orchestrator.recording.reader.source import Row, Source
from stepbus_schemas import Message, MessageError

if TYPE_CHECKING:
    from stepbus_orchestrator.recording.reader.port import Port


def array_of(values: Sequence[Any]) -> NDArray[Any] | None:
    """Return numbers and vectors of numbers as an array, anything else as one of objects.

    Shape (T,) for numbers, (T, n) for vectors, and so on. None where the values are absent in all
    messages, numbers in some, or where vectors change their length.
    """
    if values and all(value is None for value in values):
        return None
    if not values or any(_is_numeric(value) for value in values):
        try:
            array = np.array(values)
        except ValueError:
            return None
        return array if array.dtype.kind in "bif" else None
    objects = np.empty(len(values), dtype=object)
    objects[:] = list(values)
    return objects


def _is_numeric(value: Any) -> bool:
    """Return whether a value is a number, or a list or tuple of numbers at any depth."""
    while isinstance(value, list | tuple) and value:
        value = value[0]
    return isinstance(value, int | float) or value in ([], ())


_UTC = 3
"""How msgpack gives timestamps: as datetime."""


def raw_map(data: bytes) -> dict[str, Any]:
    """Return the fields of a message as they stand in its bytes; defaults are left out.

    Raises MessageError for bytes that are not one MessagePack map.
    """
    try:
        fields = msgpack.unpackb(data, strict_map_key=False, timestamp=_UTC)
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException) as exc:
        raise MessageError(f"no MessagePack: {str(exc) or type(exc).__name__}") from exc
    if not isinstance(fields, dict):
        raise MessageError(f"no MessagePack map: {type(fields).__name__}")
    return fields


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
    rows: dict[str, list[Row]] = {port.topic: [] for port in ports}
    places = {number: rows[port.topic] for port in ports for number in port.channels}
    size, newest = 0, -1
    for row in source.rows(frozenset(places)):
        if size >= most_bytes and row[1] > newest:
            yield _taken(ports, rows)
            size = 0
        places[row[0]].append(row)
        size += len(row[3])
        newest = max(newest, row[1])
    if any(rows.values()):
        yield _taken(ports, rows)


def _taken(ports: Sequence[Port], rows_of: dict[str, list[Row]]) -> dict[str, Batch]:
    """Return what was found, and empty it."""
    taken = {port.topic: Batch(port, rows_of[port.topic]) for port in ports}
    for rows in rows_of.values():
        rows.clear()
    return taken


_FLOAT = 0xCB
_FLOAT_BYTES = 9  # with the byte before it that says it is one
_FIX_MAP, _FIX_ARRAY, _FIX_STR = 0x80, 0x90, 0xA0
_MOST_FIXED = 15
_MOST_KEY = 31
_raw_fields = msgspec.msgpack.Decoder(dict[str, msgspec.Raw]).decode


def columns(
    cls: type[Message], messages: Sequence[bytes], fields: Sequence[str]
) -> dict[str, NDArray[Any] | None]:
    """Return fields of messages of one type, each as `array_of` returns its values.

    Raises MessageError for a message that is not of its type.
    """
    decode = recorded_decoder(cls)
    first = decode(messages[0]) if messages else None
    shape = _Shape.of(messages[0]) if messages else None
    table = None if shape is None else shape.table(messages)
    if first is None or shape is None or table is None:
        decoded = [decode(data) for data in messages]
        return {field: array_of(list(map(attrgetter(field), decoded))) for field in fields}
    arrays = {field: shape.floats(table, field) for field in fields}
    return {
        field: array_of([getattr(first, field)] * len(messages)) if values is None else values
        for field, values in arrays.items()
    }


class _Shape:
    """Where the floats of a message are: field → offset of the first one, how many in a vector.

    A number that is not in a vector counts as −1.
    """

    def __init__(self, length: int, floats: dict[str, tuple[int, int]]) -> None:
        self._length = length
        self._floats = floats
        self._is_same = np.ones(length, dtype=bool)
        for start, count in floats.values():
            for offset in range(start, start + abs(count) * _FLOAT_BYTES, _FLOAT_BYTES):
                self._is_same[offset + 1 : offset + _FLOAT_BYTES] = False

    @classmethod
    def of(cls, message: bytes) -> _Shape | None:
        """Return the shape of a message that is a small map; None of any other."""
        fields = _raw_fields(message)
        if not 0 < len(fields) <= _MOST_FIXED or message[0] != _FIX_MAP + len(fields):
            return None
        floats, offset = {}, 1
        for name, raw in fields.items():
            key = name.encode()
            if len(key) > _MOST_KEY or message[offset] != _FIX_STR + len(key):
                return None
            offset += 1 + len(key)
            for head, count in _vectors(bytes(raw)):
                floats[name] = (offset + head, count)
            offset += len(bytes(raw))
        return cls(len(message), floats) if offset == len(message) else None

    def table(self, messages: Sequence[bytes]) -> NDArray[np.uint8] | None:
        """Return messages as rows of bytes; None when not all have this shape."""
        if any(len(data) != self._length for data in messages):
            return None
        table = np.frombuffer(b"".join(messages), dtype=np.uint8).reshape(-1, self._length)
        return table if (table[:, self._is_same] == table[0, self._is_same]).all() else None

    def floats(self, table: NDArray[np.uint8], field: str) -> NDArray[np.float64] | None:
        """Return a field of all rows; None for one that is the same in all of them."""
        if field not in self._floats:
            return None
        start, count = self._floats[field]
        cells = table[:, start : start + abs(count) * _FLOAT_BYTES]
        numbers = np.ascontiguousarray(cells.reshape(len(table), -1, _FLOAT_BYTES)[:, :, 1:])
        values = numbers.view(">f8")[:, :, 0].astype(np.float64)
        return values[:, 0] if count < 0 else values


def _vectors(raw: bytes) -> Iterator[tuple[int, int]]:
    """Yield where the floats of a field start, and their number, where it consists of them."""
    if raw[0] == _FLOAT:
        yield 0, -1
    count = raw[0] - _FIX_ARRAY
    has_room = 0 < count <= _MOST_FIXED and len(raw) == 1 + count * _FLOAT_BYTES
    if has_room and set(raw[1::_FLOAT_BYTES]) == {_FLOAT}:
        yield 1, count
