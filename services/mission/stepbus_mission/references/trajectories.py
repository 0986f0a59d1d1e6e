"""Reference generators that follow given points: waypoints of a scenario, rows of a CSV file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from stepbus_participant.settings import Noted, Settings, nearest
from stepbus_schemas import JointReference

from .csv_table import Table, read_table
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

    Parameter waypoints: a list of `{time: 2.0, position: [0.5, 0]}` or, from the second on,
    `{duration: 2.0, position: {joint1: 0.5, joint2: 0}}`; the first one's time is 0 by default.
    Times and durations [s], positions [rad]. Before the first and after the last it is at rest.
    """

    def __init__(self, joints: Sequence[str], settings: Settings) -> None:
        times: list[float] = []
        positions: list[list[float]] = []
        for number, row in enumerate(_rows(settings)):
            where = f"waypoints[{number}]"
            times.append(_time(settings, where, row, times))
            positions.append(_position(settings, where, row, joints))
        if len(times) < 2 or any(b <= a for a, b in pairwise(times)):
            raise Noted
        self.duration = times[-1]
        self._path = _through(times, [[(p, 0.0, 0.0) for p in row] for row in positions])

    def at(self, t: float) -> JointReference:
        """See `Generator`."""
        return self._path.at(t)


def _rows(settings: Settings) -> list[Mapping[str, Any]]:
    rows = settings.value("waypoints")
    if rows is None:
        return []
    if not isinstance(rows, list | tuple) or not all(isinstance(row, Mapping) for row in rows):
        settings.note("waypoints", "is not a list of {time: …, position: …}")
        return []
    if len(rows) < 2:
        settings.note("waypoints", f"has {len(rows)} waypoint, needs at least two")
    return list(rows)


def _time(settings: Settings, where: str, row: Mapping[str, Any], times: Sequence[float]) -> float:
    for key in row:
        if key not in {"time", "duration", "position"}:
            known = ("time", "duration", "position")
            settings.note(where, f"{key!r} is unknown; {nearest(str(key), known)}")
    if not times:
        if "duration" in row:
            settings.note(where, "the first waypoint has a 'time', no 'duration'")
        return settings.as_number(f"{where}.time", row.get("time", 0.0), "not negative")
    if ("time" in row) == ("duration" in row):
        settings.note(where, "needs either a 'time' or a 'duration'")
        return times[-1] + 1.0
    if "duration" in row:
        duration = settings.as_number(f"{where}.duration", row["duration"], "positive")
        return times[-1] + duration
    time = settings.as_number(f"{where}.time", row["time"])
    if time <= times[-1]:
        settings.note(f"{where}.time", f"is {time:g} s, not after the one before ({times[-1]:g} s)")
    return time


def _position(
    settings: Settings, where: str, row: Mapping[str, Any], joints: Sequence[str]
) -> list[float]:
    if "position" not in row:
        settings.note(where, "'position' is missing")
        return [0.0] * len(joints)
    return settings.as_vector(f"{where}.position", row["position"], joints)


def _through(times: Sequence[float], knots: Sequence[Sequence[Knot]]) -> PiecewisePolynomial:
    """Return the quintic path through knots of full motion, knots[k][joint]."""
    segments = [
        [quintic(start, end, b - a) for start, end in zip(row, next_row, strict=True)]
        for a, b, row, next_row in zip(times, times[1:], knots, knots[1:], strict=False)
    ]
    return PiecewisePolynomial(
        times, segments, [p for p, _, _ in knots[0]], [p for p, _, _ in knots[-1]]
    )


class CsvTrajectory:
    """Follows the rows of a CSV file.

    Parameter file: columns `t` [s], increasing, `<joint>` [rad] and, where known,
    `<joint>_velocity` [rad/s] and `<joint>_acceleration` [rad/s²]. Between two rows a joint moves
    by a polynomial through all that its columns give: position alone, natural cubic spline
    (velocity and acceleration continuous); with velocity, cubic Hermite (velocity continuous);
    with both, quintic Hermite (acceleration continuous). The published velocity and acceleration
    are the exact derivatives of that. Before the first row and after the last it is at rest.
    """

    def __init__(self, joints: Sequence[str], settings: Settings) -> None:
        path = settings.file("file")
        if path is None:
            raise Noted
        table = read_table(path, joints)
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
    """Return one joint's polynomials, one between each two rows."""
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
