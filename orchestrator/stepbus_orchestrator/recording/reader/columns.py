"""The messages of a port as columns: fields are arrays over time."""

from collections.abc import Mapping, Sequence
from operator import attrgetter
from typing import Any

import msgpack
import msgspec
import numpy as np
from numpy.typing import NDArray

from stepbus_schemas import Decoder, Message, MessageError

_FIRST_INEXACT = 2.0**53
"""Beyond it, floats skip integers."""
Column = list[Any] | NDArray[Any]
"""The values of a field in consecutive messages."""


def array_of(*pieces: Column) -> NDArray[Any] | None:
    """Return numbers and vectors of numbers as an array, anything else as one of objects.

    Shape (T,) for numbers, (T, n) for vectors, and so on. Integers that no dtype of NumPy holds
    together are objects. None where the values are absent in all messages, numbers in some, or
    where vectors change their length.
    """
    read = [piece for piece in pieces if isinstance(piece, np.ndarray)]
    if read and len(read) == len(pieces) and len({piece.shape[1:] for piece in read}) == 1:
        return np.concatenate(read)
    lists = (piece.tolist() if isinstance(piece, np.ndarray) else piece for piece in pieces)
    values = [value for piece in lists for value in piece]
    if values and all(value is None for value in values):
        return None
    if not values or any(_is_numeric(value) for value in values):
        try:
            array = np.array(values)
        except ValueError:
            return None
        if array.dtype.kind == "f" and np.abs(array).max(initial=0.0) >= _FIRST_INEXACT:
            exact = np.array(values, dtype=object)
            return exact if all(isinstance(value, int) for value in exact.flat) else array
        return array if array.dtype.kind in "biuf" else None
    objects = np.empty(len(values), dtype=object)
    objects[:] = values
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
        raise MessageError(f"not MessagePack: {str(exc) or type(exc).__name__}") from exc
    if not isinstance(fields, dict):
        raise MessageError(f"not a MessagePack map: {type(fields).__name__}")
    return fields


_FLOAT = 0xCB
_FLOAT_BYTES = 9  # with the byte before it that says it is one
_FIX_MAP, _FIX_ARRAY, _FIX_STR = 0x80, 0x90, 0xA0
_MOST_FIXED = 15
_MOST_KEY = 31
_raw_fields = msgspec.msgpack.Decoder(dict[str, msgspec.Raw]).decode


def columns(
    cls: type[Message], messages: Sequence[bytes], fields: Sequence[str]
) -> dict[str, Column]:
    """Return fields of messages of one type.

    Messages that differ in their floats only are read at once. Raises MessageError for a message
    that is not of its type.
    """
    decode = Decoder(cls)
    first = decode(messages[0]) if messages else None
    cells = _cells(messages[0]) if messages else None
    table = None if cells is None else _table(messages, cells)
    if cells is None or table is None:
        decoded = list(map(decode, messages))
        return {field: list(map(attrgetter(field), decoded)) for field in fields}
    return {
        field: table.take(cells[field], axis=1).view(">f8")[..., 0].astype(np.float64)
        if field in cells
        else [getattr(first, field)] * len(messages)
        for field in fields
    }


def _cells(message: bytes) -> dict[str, NDArray[np.intp]] | None:
    """Return where the floats of a small map are; None of any other message.

    Field → the places of the bytes of its number, shape (8,), or of those of its vector, (n, 8).
    """
    fields = _raw_fields(message)
    if not 0 < len(fields) <= _MOST_FIXED or message[0] != _FIX_MAP + len(fields):
        return None
    cells, offset, number = {}, 1, np.arange(1, _FLOAT_BYTES)
    for name, raw in fields.items():
        key, value = name.encode(), bytes(raw)
        if len(key) > _MOST_KEY or message[offset] != _FIX_STR + len(key):
            return None
        offset += 1 + len(key)
        count = value[0] - _FIX_ARRAY
        if value[0] == _FLOAT:
            cells[name] = offset + number
        elif (
            0 < count <= _MOST_FIXED
            and len(value) == 1 + count * _FLOAT_BYTES
            and set(value[1::_FLOAT_BYTES]) == {_FLOAT}
        ):
            starts = np.arange(offset + 1, offset + len(value), _FLOAT_BYTES)
            cells[name] = starts[:, np.newaxis] + number
        offset += len(value)
    return cells if offset == len(message) else None


def _table(
    messages: Sequence[bytes], cells: Mapping[str, NDArray[np.intp]]
) -> NDArray[np.uint8] | None:
    """Return messages as rows of bytes; None when they differ in more than these cells."""
    length = len(messages[0])
    if any(len(data) != length for data in messages):
        return None
    table = np.frombuffer(b"".join(messages), dtype=np.uint8).reshape(-1, length)
    is_same = np.ones(length, dtype=bool)
    for places in cells.values():
        is_same[places] = False
    return table if (table[:, is_same] == table[0, is_same]).all() else None
