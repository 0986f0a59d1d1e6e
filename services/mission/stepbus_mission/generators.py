"""Reference generators: one class or function for each task of a mission."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import cos, sin
from typing import Any, Protocol

from stepbus_mission.csv_table import Table, read_table
from stepbus_mission.params import SineParams, StepParams, TableParams, WaypointParams, time_of
from stepbus_mission.polynomials import (
    PiecewisePolynomial,
    Polynomial,
    at_rest,
    cubic,
    natural_spline_velocities,
    quintic,
)
from stepbus_schemas import JointReference


class Generator(Protocol):
    """The interface of a reference generator, built-in or your own.

    The constructor takes the joints and the parameters: those of the mission, or an instance of
    its own class `Params`. A generator that ends has an attribute `duration` [s]; after that, the
    reference is at rest.
    """

    def at(self, t: float, /) -> JointReference:
        """Return position, velocity and acceleration of every joint.

        t: simulation time [s]. Vectors have shape (n,), in the order of `joints`; velocity and
        acceleration are the exact derivatives of the position.
        """
        ...


class Sine:
    """q(t) = offset + amplitude · sin(omega t + phase), per joint.

    shift: angles that changes of omega have added to the phases, shape (n,) [rad]; None: there were
    none.
    """

    def __init__(
        self, joints: Sequence[str], params: SineParams, shift: Sequence[float] | None = None
    ) -> None:
        self.shift = list(shift or [0.0] * len(joints))
        self._omega = params.omega.of(joints)
        phases, offsets = params.phase.of(joints), params.offset.of(joints)
        amplitudes = params.amplitude.of(joints)
        rows = zip(amplitudes, self._omega, phases, self.shift, offsets, strict=True)
        self._rows = [
            (amplitude, omega, phase + shift, offset, amplitude * omega, -omega * omega)
            for amplitude, omega, phase, shift, offset in rows
        ]

    def changed(self, joints: Sequence[str], params: SineParams, t: float) -> "Sine":
        """Return the sine of other parameters from a time on [s]; another omega keeps the angle."""
        rows = zip(self.shift, self._omega, params.omega.of(joints), strict=True)
        return Sine(joints, params, [shift + (before - now) * t for shift, before, now in rows])

    def at(self, t: float) -> JointReference:
        """See `Generator`."""
        position, velocity, acceleration = [], [], []
        for amplitude, omega, phase, offset, speed, stiffness in self._rows:
            angle = omega * t + phase
            swing = amplitude * sin(angle)
            position.append(offset + swing)
            velocity.append(speed * cos(angle))
            acceleration.append(stiffness * swing)
        return JointReference(position=position, velocity=velocity, acceleration=acceleration)


class StepChange:
    """Jumps from `initial` to `target` at `time`; its derivatives are zero."""

    def __init__(self, joints: Sequence[str], params: StepParams) -> None:
        self._time = params.time
        self._before = at_rest(params.initial.of(joints))
        self._after = at_rest(params.target.of(joints))

    def at(self, t: float) -> JointReference:
        """See `Generator`."""
        return self._before if t < self._time else self._after


def waypoints(joints: Sequence[str], params: WaypointParams) -> PiecewisePolynomial:
    """Return a path from waypoint to waypoint with minimum jerk, coming to rest at each."""
    times: list[float] = []
    for row in params.waypoints:
        times.append(time_of(row, times[-1] if times else 0.0))
    positions = [row.position.of(joints) for row in params.waypoints]
    polynomials = [
        [
            quintic((start, 0.0, 0.0), (end, 0.0, 0.0), b - a)
            for (a, b), (start, end) in zip(pairwise(times), pairwise(path), strict=True)
        ]
        for path in zip(*positions, strict=True)
    ]
    return PiecewisePolynomial(times, polynomials, positions[0], positions[-1])


def csv_trajectory(joints: Sequence[str], params: TableParams) -> PiecewisePolynomial:
    """Return a path through the rows of a CSV file.

    A joint follows a polynomial between two rows, according to its columns: with position alone, a
    natural cubic spline (velocity and acceleration continuous); with velocity, cubic Hermite
    (velocity continuous); with both derivatives, quintic Hermite (acceleration continuous). The
    published velocity and acceleration are its exact derivatives.
    """
    table = read_table(params.file, joints)
    return PiecewisePolynomial(
        table.times,
        [_segments(table, joint) for joint in joints],
        [table.columns[joint][0] for joint in joints],
        [table.columns[joint][-1] for joint in joints],
    )


def _segments(table: Table, joint: str) -> list[Polynomial]:
    """Return one joint's polynomials, one per pair of consecutive rows."""
    times, positions = table.times, table.columns[joint]
    velocities = table.columns.get(f"{joint}_velocity")
    accelerations = table.columns.get(f"{joint}_acceleration")
    steps = [b - a for a, b in pairwise(times)]
    if velocities is not None and accelerations is not None:
        full = pairwise(zip(positions, velocities, accelerations, strict=True))
        return [quintic(start, end, h) for (start, end), h in zip(full, steps, strict=True)]
    velocities = velocities or natural_spline_velocities(times, positions)
    knots = pairwise(zip(positions, velocities, strict=True))
    return [cubic(start, end, h) for (start, end), h in zip(knots, steps, strict=True)]


TASKS: Mapping[str, Callable[[Sequence[str], Any], Generator]] = {
    "csv": csv_trajectory,
    "sine": Sine,
    "step": StepChange,
    "waypoints": waypoints,
}
"""Value of `task` in the scenario → what makes its generator."""
STEERED: Mapping[str, Mapping[str, str]] = {
    "sine": {"amplitude": "rad", "omega": "rad/s", "phase": "rad", "offset": "rad"},
    "step": {"target": "rad", "initial": "rad", "time": "s"},
}
"""Task → its parameters that calls can set, with their units."""


def duration_of(generator: Generator) -> float:
    """Return when a generator comes to rest for good [s]; infinity: never."""
    return float(getattr(generator, "duration", math.inf))
