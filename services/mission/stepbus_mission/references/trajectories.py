"""Reference generators through given points: waypoints of a scenario, rows of a CSV file."""

from collections.abc import Sequence
from itertools import pairwise

from stepbus_schemas import JointReference

from .csv_table import Table, read_table
from .params import Params, time_of
from .polynomials import (
    Knot,
    PiecewisePolynomial,
    Polynomial,
    cubic,
    natural_spline_velocities,
    quintic,
)


class Waypoints:
    """Moves from waypoint to waypoint with minimum jerk, coming to rest at each.

    Before the first and after the last it is at rest.
    """

    def __init__(self, joints: Sequence[str], params: Params) -> None:
        times: list[float] = []
        for row in params.waypoints:
            times.append(time_of(row, times[-1] if times else 0.0))
        self.duration = times[-1]
        knots = [[(p, 0.0, 0.0) for p in row.position.of(joints)] for row in params.waypoints]
        self._path = _through(times, knots)

    def at(self, t: float) -> JointReference:
        """See `Generator`."""
        return self._path.at(t)


def _through(times: Sequence[float], knots: Sequence[Sequence[Knot]]) -> PiecewisePolynomial:
    """Return the quintic path through knots[k][joint]."""
    segments = [
        [quintic(start, end, b - a) for start, end in zip(here, there, strict=True)]
        for a, b, here, there in zip(times, times[1:], knots, knots[1:], strict=False)
    ]
    return PiecewisePolynomial(
        times, segments, [p for p, _, _ in knots[0]], [p for p, _, _ in knots[-1]]
    )


class CsvTrajectory:
    """Follows the rows of a CSV file.

    A joint follows a polynomial between two rows, according to its columns: with position alone, a
    natural cubic spline (velocity and acceleration continuous); with velocity, cubic Hermite
    (velocity continuous); with both derivatives, quintic Hermite (acceleration continuous). The
    published velocity and acceleration are its exact derivatives. Before the first row and after
    the last it is at rest.
    """

    def __init__(self, joints: Sequence[str], params: Params) -> None:
        table = read_table(params.file, joints)
        self.duration = table.times[-1]
        self._path = _interpolate(table, joints)

    def at(self, t: float) -> JointReference:
        """See `Generator`."""
        return self._path.at(t)


def _interpolate(table: Table, joints: Sequence[str]) -> PiecewisePolynomial:
    by_joint = [_segments(table, joint) for joint in joints]
    return PiecewisePolynomial(
        table.times,
        list(zip(*by_joint, strict=True)),
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
        full = list(zip(positions, velocities, accelerations, strict=True))
        return [quintic(full[k], full[k + 1], h) for k, h in enumerate(steps)]
    knots = list(
        zip(positions, velocities or natural_spline_velocities(times, positions), strict=True)
    )
    return [cubic(knots[k], knots[k + 1], h) for k, h in enumerate(steps)]
