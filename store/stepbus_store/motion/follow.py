"""Paths of joints and of the tip, and what goals may make of them."""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import Indices, RobotModel, SelfCollisions, Vector
from stepbus_store.cause import Cause
from stepbus_store.motion.ik_search import SINGULAR_BELOW, displacement, smallest_singular_value
from stepbus_store.motion.outcome import Refused


@dataclass(frozen=True, kw_only=True)
class JointPath:
    """Cubic Hermite interpolation of joint positions over a parameter u.

    u: shape (k,), increasing. q: shape (k, n) [rad]. slope: dq/du, shape (k, n).
    """

    u: Vector
    q: Vector
    slope: Vector

    @cached_property
    def _knots(self) -> list[float]:
        """Return u as numbers of Python, which are quicker one by one."""
        knots: list[float] = self.u.tolist()
        return knots

    @cached_property
    def _ends(self) -> Vector:
        """Return the ends and the tangents of each piece, shape (k - 1, 4, n)."""
        widths = np.diff(self.u)[:, np.newaxis]
        tangents = (widths * self.slope[:-1], widths * self.slope[1:])
        return np.stack([self.q[:-1], self.q[1:], *tangents], axis=1)

    def at(self, u: float) -> tuple[Vector, Vector, Vector]:
        """Return q, dq/du and d²q/du² at u, each of shape (n,); u is clipped to the path."""
        knots = self._knots
        piece = min(max(bisect_right(knots, u) - 1, 0), len(knots) - 2)
        width = knots[piece + 1] - knots[piece]
        x = min(max((u - knots[piece]) / width, 0.0), 1.0)
        one, two = 6 * x * (x - 1) / width, (12 * x - 6) / width**2
        blend = np.array(
            [
                [1 + x * x * (2 * x - 3), x * x * (3 - 2 * x), x * (1 - x) ** 2, x * x * (x - 1)],
                [one, -one, (1 + x * (3 * x - 4)) / width, x * (3 * x - 2) / width],
                [two, -two, (6 * x - 4) / width**2, (6 * x - 2) / width**2],
            ]
        )
        q, slope, curve = blend @ self._ends[piece]
        return q, slope, curve


def joint_path(points: Sequence[Vector]) -> JointPath:
    """Return a smooth path through joint positions, each of shape (n,), over their distance [rad].

    The slopes are those of Catmull and Rom; points closer than 1e-9 rad to the one before are left
    out. Raises Refused where fewer than two are left.
    """
    kept: list[Vector] = []
    for point in points:
        if not kept or float(np.linalg.norm(point - kept[-1])) > 1e-9:
            kept.append(point)
    if len(kept) < 2:
        raise Refused(Cause.NO_PATH, "the path has no length: the arm is there already")
    q = np.array(kept)
    u = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])
    return JointPath(u=u, q=q, slope=np.gradient(q, u, axis=0))


EVERY_M = 0.01
"""Distance of the poses of a path for which the joints are solved [m]; cubics with exact slopes
stay within a micrometre of the path in between."""

_EVERY_RAD = 0.05
"""The same, where the tip turns [rad]."""


@dataclass(frozen=True, kw_only=True)
class TipPose:
    """One pose on a path of the tip.

    u: length of the path so far [m]; turning counts too, see `line`. pose: of the tip in the
    robot's base, a `pinocchio.SE3`. twist: its derivative by u, in the axes of the base, shape
    (6,) [-, rad/m].
    """

    u: float
    pose: Any
    twist: Vector


def line(start: Any, end: Any, radius: float) -> list[TipPose]:
    """Return the straight path between two `pinocchio.SE3`, turning evenly (slerp).

    radius: length that a turn of 1 rad counts, where turning takes longer than moving [m].
    """
    whole = displacement(start, end)
    shift, turn = whole[:3], whole[3:]
    far, angle = float(np.linalg.norm(shift)), float(np.linalg.norm(turn))
    length = max(far, angle * radius)
    if length < 1e-9:
        return []
    count = max(math.ceil(far / EVERY_M), math.ceil(angle / _EVERY_RAD), 1)
    twist = whole / length
    poses = []
    for share in np.linspace(0.0, 1.0, count + 1):
        rotation = pin.exp3(turn * share) @ start.rotation
        pose = pin.SE3(rotation, start.translation + share * shift)
        poses.append(TipPose(u=float(share) * length, pose=pose, twist=twist))
    return poses


_CLOSE = 1e-5
"""Error at which one more step of Newton's method is the last: it squares the error [m, rad]."""

_LARGEST_STEP = 0.3
"""Of a joint between two poses [rad]; more is a jump to another branch."""


class PathLost(Refused):
    """A path of the tip that the joints cannot follow; index: of the first such pose."""

    def __init__(self, cause: Cause, text: str, index: int) -> None:
        super().__init__(cause, text)
        self.index = index


def follow(robot: RobotModel, tip: str, path: Sequence[TipPose], start: Vector) -> JointPath:
    """Return the joints along a path of the tip, staying on the branch of their start.

    start: where the tip is at the first pose, shape (n,) [rad]. Between two poses the joints are
    predicted by the Jacobian, then corrected by Newton's method. Raises PathLost with cause
    unreachable, limits or singular where the path leaves the branch.
    """
    chain, number = robot.chain(tip), robot.frame_id(tip)
    q, slope = start, np.zeros(len(start))
    rows: list[Vector] = []
    slopes: list[Vector] = []
    for index, pose in enumerate(path):
        ahead = pose.u - path[index - 1].u if index else 0.0
        try:
            q, slope = _step(robot, number, chain, pose, before=q, guess=q + slope * ahead)
        except Refused as exc:
            text = f"{exc} after {pose.u:.3f} of {path[-1].u:.3f} m of the path"
            raise PathLost(exc.cause, text, index) from exc
        rows.append(q)
        slopes.append(slope)
    u = np.array([pose.u for pose in path])
    return JointPath(u=u, q=np.array(rows), slope=np.array(slopes))


def _step(
    robot: RobotModel,
    number: int,
    chain: Indices,
    wanted: TipPose,
    *,
    before: Vector,
    guess: Vector,
) -> tuple[Vector, Vector]:
    """Return joints at a pose and their slope, from those before and a guess."""
    q = guess.copy()
    for _ in range(10):
        now, matrix = robot.jacobian(q, number)
        error, jacobian = displacement(now, wanted.pose), matrix[:, chain]
        if np.abs(q - before).max() > _LARGEST_STEP:
            _check_singular(jacobian)
            raise Refused(Cause.SINGULAR, "singular: the joints would jump to another branch")
        if np.abs(error).max() < _CLOSE:
            _check_singular(jacobian)
            slope = np.zeros(len(q))
            step, slope[chain] = _solved(jacobian, np.stack([error, wanted.twist], axis=1)).T
            q[chain] += step
            _check_limits(robot, q)
            return q, slope
        q[chain] += _solved(jacobian, error)
    miss = float(np.linalg.norm(error[:3])) * 1e3
    raise Refused(Cause.UNREACHABLE, f"unreachable: the tip stays {miss:.1f} mm away")


def _check_singular(jacobian: Vector) -> None:
    least = smallest_singular_value(jacobian)
    if least < SINGULAR_BELOW:
        text = f"the smallest singular value falls to {least:.4f}, below {SINGULAR_BELOW:.4f},"
        raise Refused(Cause.SINGULAR, f"singular: {text}")


def _check_limits(robot: RobotModel, q: Vector) -> None:
    beyond = np.maximum(robot.lower - q, q - robot.upper)
    worst = int(np.argmax(beyond))
    if beyond[worst] > 1e-9:
        joint, low, high = robot.joints[worst], robot.lower[worst], robot.upper[worst]
        text = f"{joint} would have to go to {q[worst]:.3f} {robot.unit(joint)}"
        text = f"out of limits: {text}, its limits are [{low:.3f}, {high:.3f}],"
        raise Refused(Cause.LIMITS, text)


def _solved(jacobian: Vector, twist: Vector) -> Vector:
    """Return the joint velocities of twists, shape (6,) or (6, k); jacobian: shape (6, m)."""
    if jacobian.shape[1] == 6:
        try:
            return np.asarray(np.linalg.solve(jacobian, twist), dtype=np.float64)
        except np.linalg.LinAlgError:
            pass
    return np.asarray(np.linalg.lstsq(jacobian, twist, rcond=None)[0], dtype=np.float64)


_CHECKED_EVERY = 0.01
"""Distance of the joint positions that are checked [rad]."""


def check_path(path: JointPath, collisions: SelfCollisions | None, *, leaves: bool = False) -> None:
    """Raise Refused with both links where the robot would touch itself on a path of the tip.

    leaves: the robot is at its start, and may leave what it touches there.
    """
    if collisions is None:
        return
    far = float(np.abs(np.diff(path.q, axis=0)).max(axis=1).sum())
    count = max(math.ceil(far / _CHECKED_EVERY), 1)
    known = collisions.pair(path.q[0]) if leaves else None
    for u in np.linspace(path.u[0], path.u[-1], count + 1):
        q, _, _ = path.at(float(u))
        pair = collisions.pair(q) if collisions.any(q) else None
        if pair is not None and pair != known:
            text = f"{pair[0]} would touch {pair[1]} after {u - path.u[0]:.3f} m of the path"
            raise Refused(Cause.IN_COLLISION, text)


_AT_ONCE = 1e-6
"""Distance of a target that needs no motion [rad]."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """Joint positions to go to, shape (n,) [rad].

    paths: of the joints from there on, over the length of the tip's path [m]. text: description.
    holds: whether the motors can hold the arm there.
    """

    target: Vector
    paths: tuple[JointPath, ...] = ()
    text: str = ""
    holds: bool = True

    def is_at(self, q: Vector) -> bool:
        """Return whether joint positions are those to go to, shape (n,) [rad]."""
        return float(np.abs(self.target - q).max()) < _AT_ONCE
