"""Reference generators: pure classes behind one seam; here those given by a formula."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

from stepbus_participant.settings import Settings
from stepbus_schemas import JointReference


class Generator(Protocol):
    """What a reference generator is, also a user's own.

    Constructed with the joints and the settings, out of which it reads its parameters. Where it
    comes to an end, it has an attribute `duration` [s]; the reference after that is at rest.
    """

    def __init__(self, joints: Sequence[str], settings: Settings) -> None: ...

    def at(self, t: float, /) -> JointReference:
        """Return position, velocity and acceleration of every joint.

        t: simulation time [s]. Each vector has shape (n,) and the order of `joints`; velocity and
        acceleration are the exact derivatives of the position.
        """
        ...


class Sine:
    """q(t) = offset + amplitude · sin(omega t + phase), per joint.

    Parameters, each one number for all joints, a list, or a map by name: amplitude [rad], omega
    [rad/s], phase [rad], offset [rad].
    """

    def __init__(self, joints: Sequence[str], settings: Settings) -> None:
        self._rows = tuple(
            zip(
                settings.per_name("amplitude", joints, 1.0),
                settings.per_name("omega", joints, 1.0),
                settings.per_name("phase", joints, 0.0),
                settings.per_name("offset", joints, 0.0),
                strict=True,
            )
        )

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
    """Stands at `initial` before `time` and at `target` from then on; its derivatives are zero.

    Parameters: target and initial [rad], each one number for all joints, a list, or a map by
    name; time [s].
    """

    def __init__(self, joints: Sequence[str], settings: Settings) -> None:
        self._time = settings.number("time", 0.0)
        self._before = at_rest(settings.per_name("initial", joints, 0.0))
        self._after = at_rest(settings.per_name("target", joints))

    def at(self, t: float) -> JointReference:
        """See `Generator`."""
        return self._before if t < self._time else self._after


def at_rest(position: Sequence[float]) -> JointReference:
    """Return a reference that stands still; position: shape (n,) [rad]."""
    zeros = [0.0] * len(position)
    return JointReference(position=list(position), velocity=zeros, acceleration=zeros)
