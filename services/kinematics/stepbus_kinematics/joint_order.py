"""Bring the vectors of a port into the controller's own joint order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stepbus_participant.settings import nearest
from stepbus_schemas import RunError, WiringError

from .dynamics import Vector


class JointOrder:
    """Where the controller's joints stand in the vectors of one port.

    port: its name, for messages. given: the port's names. wanted: the controller's.
    Raises WiringError when a joint is missing or stands there twice.
    """

    def __init__(self, port: str, given: Sequence[str], wanted: Sequence[str]) -> None:
        problems = [
            f"input {port!r} has no joint {name!r}; {nearest(name, given)}"
            for name in wanted
            if name not in given
        ]
        problems += [
            f"input {port!r} has joint {name!r} {given.count(name)} times"
            for name in wanted
            if given.count(name) > 1
        ]
        if problems:
            raise WiringError("\n".join(problems))
        self._port = port
        self._length = len(given)
        self._index = [given.index(name) for name in wanted]

    def pick(self, values: Sequence[float] | None, quantity: str) -> Vector:
        """Return one quantity of a message, shape (n,), in the controller's order.

        Raises RunError when the message lacks it or it is of the wrong length.
        """
        if values is None:
            raise RunError(f"input {self._port!r} carries no {quantity}")
        if len(values) != self._length:
            raise RunError(
                f"input {self._port!r} carries {len(values)} {quantity} values for "
                f"{self._length} joints"
            )
        return np.array([values[i] for i in self._index])
