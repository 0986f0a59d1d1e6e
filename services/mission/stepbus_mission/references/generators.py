"""The interface of reference generators, and those given by a formula."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

from stepbus_schemas import JointReference

from .params import Params


class Generator(Protocol):
    """The interface of a reference generator, built-in or your own.

    The constructor takes the joints and the parameters: those of the mission, or those that its own
    class `Params` declares. A generator that ends has an attribute `duration` [s]; after it, the
    reference is at rest.
    """

    def __init__(self, joints: Sequence[str], params: Any) -> None: ...

    def at(self, t: float, /) -> JointReference:
        """Return position, velocity and acceleration of every joint.

        t: simulation time [s]. Vectors have shape (n,), in the order of `joints`; velocity and
        acceleration are the exact derivatives of the position.
        """
        ...


SineRow = tuple[float, float, float, float, float]
"""Of one joint: amplitude [rad], omega [rad/s], phase, offset, and the angle that changes of omega
have added to the phase [rad]."""


class Sine:
    """q(t) = offset + amplitude · sin(omega t + phase), per joint."""

    def __init__(self, joints: Sequence[str], params: Params) -> None:
        self._shift = (0.0,) * len(joints)
        self._rows = tuple(
            zip(
                params.amplitude.of(joints),
                params.omega.of(joints),
                params.phase.of(joints),
                params.offset.of(joints),
                strict=True,
            )
        )

    def changed(self, joints: Sequence[str], params: Params, t: float) -> Sine:
        """Return the sine of other parameters from a time on [s]; another omega keeps the angle."""
        found = Sine(joints, params)
        omegas = [(row[1], new[1]) for row, new in zip(self._rows, found._rows, strict=True)]
        found._shift = tuple(
            shift + (before - now) * t
            for shift, (before, now) in zip(self._shift, omegas, strict=True)
        )
        found._rows = tuple(
            (amplitude, omega, phase + shift, offset)
            for (amplitude, omega, phase, offset), shift in zip(
                found._rows, found._shift, strict=True
            )
        )
        return found

    def save(self) -> list[SineRow]:
        """Return a row for each joint, for a checkpoint."""
        return [(*row, shift) for row, shift in zip(self._rows, self._shift, strict=True)]

    def restore(self, rows: Sequence[SineRow]) -> None:
        """Take what `save` returned."""
        self._rows = tuple(row[:4] for row in rows)
        self._shift = tuple(row[4] for row in rows)

    def at(self, t: float) -> JointReference:
        """See `Generator`."""
        position, velocity, acceleration = [], [], []
        for amplitude, omega, phase, offset in self._rows:
            angle = omega * t + phase
            swing = amplitude * math.sin(angle)
            position.append(offset + swing)
            velocity.append(amplitude * omega * math.cos(angle))
            acceleration.append(-omega * omega * swing)
        return JointReference(position=position, velocity=velocity, acceleration=acceleration)


class StepChange:
    """Jumps from `initial` to `target` at `time`; its derivatives are zero."""

    def __init__(self, joints: Sequence[str], params: Params) -> None:
        self._time = params.time
        self._before = at_rest(params.initial.of(joints))
        self._after = at_rest(params.target.of(joints))

    def at(self, t: float) -> JointReference:
        """See `Generator`."""
        return self._before if t < self._time else self._after


def at_rest(position: Sequence[float]) -> JointReference:
    """Return a constant reference; position: shape (n,) [rad]."""
    zeros = [0.0] * len(position)
    return JointReference(position=list(position), velocity=zeros, acceleration=zeros)
