"""The messages of a port as columns: fields are arrays over time."""

from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from stepbus_schemas import MessageError

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
