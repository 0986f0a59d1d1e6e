"""Bring the vectors of a port into a joint order of your own."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from stepbus_participant import InvalidInput, Problems, suggest
from stepbus_schemas import Description, RunError, WiringError

from .model import Vector


class JointOrder:
    """Picks joints by name from the vectors of one port.

    port: its name, for messages. given: the port's joints, in its order. wanted: yours, in yours.
    Raises WiringError that lists joints that are missing or duplicated.
    """

    def __init__(self, port: str, given: Sequence[str], wanted: Sequence[str]) -> None:
        problems = [
            f"input {port!r} has no joint {name!r}{suggest(name, given)}"
            for name in wanted
            if name not in given
        ]
        problems += [
            f"input {port!r} lists joint {name!r} {given.count(name)} times"
            for name in wanted
            if given.count(name) > 1
        ]
        if problems:
            raise WiringError("\n".join(problems))
        self._port = port
        self._length = len(given)
        self._index = [given.index(name) for name in wanted]
        self._is_same = list(given) == list(wanted)

    def pick(self, values: Sequence[float] | None, quantity: str) -> Vector:
        """Return one quantity of a message, shape (n,), in your order; errors as of `ordered`."""
        return np.array(self.ordered(values, quantity))

    def ordered(self, values: Sequence[float] | None, quantity: str) -> Sequence[float]:
        """Return one quantity of a message in your order, as a list, which may be the message's.

        Raises RunError for a message without it, InvalidInput for another number of values.
        """
        if values is None:
            raise RunError(f"input {self._port!r} carries no {quantity}")
        if len(values) != self._length:
            raise InvalidInput(
                self._port, f"carries {len(values)} {quantity} values for {self._length} joints"
            )
        return values if self._is_same else [values[i] for i in self._index]


def joint_orders(
    who: str, inputs: Mapping[str, Description], ports: Sequence[str], wanted: Sequence[str]
) -> list[JointOrder]:
    """Return the joint orders of several ports.

    who: the participant, for messages. Raises SettingsError that lists what is wrong with any.
    """
    problems = Problems(above=("participants", who))
    orders = (
        problems.attempt((), partial(JointOrder, port, inputs[port].names, wanted))
        for port in ports
    )
    known = [order for order in orders if order is not None]
    problems.refuse()
    return known
