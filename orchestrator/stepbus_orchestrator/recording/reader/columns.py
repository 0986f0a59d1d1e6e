"""Fields of many messages as arrays, without an object for each number.

The messages of a port mostly have the same bytes but for their 64-bit floats. Where they do, the
floats are taken right out of the bytes; any others are decoded one by one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from operator import attrgetter
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.recording.earlier import recorded_decoder
from stepbus_schemas import Message

from .arrays import array_of

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
    found = {field: shape.floats(table, field) for field in fields}
    return {
        field: array_of([getattr(first, field)] * len(messages)) if values is None else values
        for field, values in found.items()
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
