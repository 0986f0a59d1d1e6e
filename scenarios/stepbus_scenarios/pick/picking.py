"""How a cube is picked: the stages, where they lead, and the motion from one to the next."""

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import msgspec

from stepbus_scenarios.pick.scara import Scara, Spot
from stepbus_schemas import Point, Quaternion, RunError

Stage = Literal[
    "reach", "descend", "grip", "lift", "carry", "lower", "release", "retreat", "settle", "over"
]
"""What a pick is doing."""

Waypoint = Literal["above_cube", "at_cube", "above_goal", "at_goal"]
"""Where the arm goes."""

NEXT: Mapping[Stage, Stage] = {
    "reach": "descend",
    "descend": "grip",
    "grip": "lift",
    "lift": "carry",
    "carry": "lower",
    "lower": "release",
    "release": "retreat",
    "retreat": "settle",
    "settle": "over",
}
"""Stage → the one that follows."""

MOVES: Mapping[Stage, Waypoint] = {
    "reach": "above_cube",
    "descend": "at_cube",
    "lift": "above_cube",
    "carry": "above_goal",
    "lower": "at_goal",
    "retreat": "above_goal",
}
"""Stage of a motion → where it ends; in the others the arm stands."""

CLOSED: frozenset[Stage] = frozenset(("grip", "lift", "carry", "lower"))
"""Stages in which the gripper is closed."""

CARRIES: frozenset[Stage] = frozenset(("lift", "carry", "lower"))
"""Stages in which the gripper holds the cube."""

_SHORTEST = 0.2
"""Of a motion [s]."""

_PEAK = 1.875
"""Largest velocity of a minimum-jerk motion, relative to its mean."""


class Motion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A motion with minimum jerk, at rest at both ends.

    start, end: joint positions, shape (4,) [rad, rad, m, rad]. duration: [s].
    """

    start: tuple[float, ...]
    end: tuple[float, ...]
    duration: float

    def at(self, t: float) -> list[float]:
        """Return the joint positions, shape (4,); t: time since its start [s]."""
        if t >= self.duration:
            return list(self.end)
        u = max(t / self.duration, 0.0)
        # Flash and Hogan, J. Neurosci. 5(7), 1985, appendix A.
        share = ((6.0 * u - 15.0) * u + 10.0) * u * u * u
        return [a + (b - a) * share for a, b in zip(self.start, self.end, strict=True)]


def motion(arm: Scara, start: Sequence[float], end: Sequence[float], speed: float) -> Motion:
    """Return the motion between two positions, shape (4,) each.

    speed: largest share of the velocity limits that a joint needs [-].
    """
    times = [
        _PEAK * abs(b - a) / (speed * limit)
        for a, b, limit in zip(start, end, arm.velocity, strict=True)
    ]
    return Motion(tuple(start), tuple(end), max(*times, _SHORTEST))


def plan(
    arm: Scara, cube: Spot, goal: Spot, *, grip_height: float, clearance: float
) -> dict[Waypoint, tuple[float, ...]]:
    """Return the joint positions of each waypoint, shape (4,) [rad, rad, m, rad].

    goal: where the cube shall stand. grip_height: of the tip over the bottom of the cube;
    clearance: how far the cube is lifted [m]. A side of the cube is as good as another one.
    Raises RunError where a waypoint is out of reach.
    """
    waypoints: dict[Waypoint, tuple[float, ...]] = {}
    wrist = 0.0
    rows: tuple[tuple[str, Spot, Waypoint, Waypoint], ...] = (
        ("the cube", cube, "above_cube", "at_cube"),
        ("the goal", goal, "above_goal", "at_goal"),
    )
    for what, spot, above, at in rows:
        for name, raised in ((above, clearance), (at, 0.0)):
            tip = Spot(x=spot.x, y=spot.y, z=spot.z + grip_height + raised, yaw=spot.yaw)
            q = arm.inverse(tip, near=wrist)
            if q is None:
                raise RunError(
                    f"the arm cannot reach {what} at {spot} in the frame of its base, with its tip "
                    f"at a height of {tip.z:.3f} m; it reaches distances of "
                    f"{abs(arm.near - arm.far):.3f} to {arm.near + arm.far:.3f} m and heights of "
                    f"{arm.lowest:.3f} to {arm.height + arm.upper[2]:.3f} m"
                )
            waypoints[name], wrist = tuple(q), q[3]
    return waypoints


def spot_of(
    base: tuple[Point, Quaternion], cube: tuple[Point, Quaternion], name: str = "cube"
) -> Spot:
    """Return where a cube stands; base, cube: poses in the world, that of the base upright.

    Raises RunError for a pose that is not finite; name: of the cube.
    """
    (bx, by, bz), turn = base
    (x, y, z), orientation = cube
    if not math.isfinite(sum((bx, by, bz, *turn, x, y, z, *orientation))):
        raise RunError(f"the pose of {name} or of the arm's base is not finite")
    yaw = yaw_of(turn)
    dx, dy, c, s = x - bx, y - by, math.cos(yaw), math.sin(yaw)
    heading = math.remainder(yaw_of(orientation) - yaw, math.tau)
    return Spot(x=c * dx + s * dy, y=c * dy - s * dx, z=z - bz, yaw=heading)


def yaw_of(orientation: Quaternion) -> float:
    """Return the heading of a pose [rad]; orientation: quaternion x, y, z, w."""
    x, y, z, w = orientation
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def distance(one: Spot, other: Spot) -> float:
    """Return how far one cube is from the other [m], its height included."""
    return math.dist((one.x, one.y, one.z), (other.x, other.y, other.z))


def turn(one: Spot, other: Spot) -> float:
    """Return by how much one cube is turned from the other [rad], up to quarters of a turn."""
    return abs(math.remainder(one.yaw - other.yaw, math.pi / 2))
