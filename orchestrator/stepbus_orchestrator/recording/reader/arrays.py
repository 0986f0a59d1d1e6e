"""Values of one field over time as an array."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray


def array_of(values: Sequence[Any]) -> NDArray[Any] | None:
    """Return numbers and vectors of numbers as an array, anything else as one of objects.

    Shape (T,) for numbers, (T, n) for vectors, and so on. None where the values are absent in all
    messages, numbers in some, or where vectors change their length.
    """
    if values and all(value is None for value in values):
        return None
    if not values or any(_is_numeric(value) for value in values):
        try:
            found = np.array(values)
        except ValueError:
            return None
        return found if found.dtype.kind in "bif" else None
    objects = np.empty(len(values), dtype=object)
    objects[:] = list(values)
    return objects


def _is_numeric(value: Any) -> bool:
    """Return whether a value is a number, or a list or tuple of numbers at any depth."""
    while isinstance(value, list | tuple) and value:
        value = value[0]
    return isinstance(value, int | float) or value in ([], ())
