"""Ways of the tip, straight and spiral, and the joints that follow them on one branch."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import RobotModel, Vector
from stepbus_motion.goals.outcome import Refused

from .trajectories import JointPath

_EVERY_M = 0.01
_EVERY_RAD = 0.05
"""Distance of the poses of a way for which the joints are solved; cubics with exact slopes stay
within a micrometre of the way in between."""

_CLOSE = 1e-5
"""Error at which one more step of Newton's method is the last: it squares the error [m, rad]."""

_LARGEST_STEP = 0.3
"""Of a joint between two poses [rad]; more is a jump to another branch."""


@dataclass(frozen=True, kw_only=True)
class TipPose:
    """One pose of a way.

    u: way so far [m]; turning counts too, see `Line`. pose: of the tip in the robot's base, a
    `pinocchio.SE3`. twist: its derivative by u, in the axes of the base, shape (6,) [-, rad/m].
    """

    u: float
    pose: Any
    twist: Vector


class Lost(Refused):
    """A way of the tip that the joints cannot follow; place: number of the first such pose."""

    def __init__(self, cause: str, text: str, place: int) -> None:
        super().__init__(cause, text)
        self.place = place


def line(start: Any, end: Any, radius: float) -> list[TipPose]:
    """Return the straight way between two `pinocchio.SE3`, turning evenly (slerp).

    radius: so long counts a turn of 1 rad, where turning takes longer than moving [m].
    """
    way = end.translation - start.translation
    turn = start.rotation @ pin.log3(start.rotation.T @ end.rotation)
    angle = float(np.linalg.norm(turn))
    length = max(float(np.linalg.norm(way)), angle * radius)
    if length < 1e-9:
        return []
    count = max(math.ceil(np.linalg.norm(way) / _EVERY_M), math.ceil(angle / _EVERY_RAD), 1)
    twist = np.concatenate([way, turn]) / length
    poses = []
    for share in np.linspace(0.0, 1.0, count + 1):
        rotation = pin.exp3(turn * share) @ start.rotation
        pose = pin.SE3(rotation, start.translation + share * way)
        poses.append(TipPose(u=float(share) * length, pose=pose, twist=twist))
    return poses


@dataclass(frozen=True, kw_only=True)
class SpiralCurve:
    """Around a vertical, from one radius to another, gaining height; angles and heights even.

    centre: x, y, z in the robot's base; z is the height at which it begins [m]. radius: at its
    beginning and its end [m]. turns: counter-clockwise, below 0: clockwise. rise: [m].
    begins_at: angle of its first point [rad]. rotation: of the tip, shape (3, 3). raised: by how
    much at each of its points, shape (k,) [m]; between two points the height blends smoothly.
    """

    centre: Vector
    radius: tuple[float, float]
    turns: float
    rise: float
    begins_at: float
    rotation: Vector
    raised: Vector

    def at(self, share: float) -> tuple[Any, Vector]:
        """Return the pose at a share of the angle, and the velocity by that share, shape (3,)."""
        whole = 2 * math.pi * self.turns
        widening = self.radius[1] - self.radius[0]
        radius = self.radius[0] + share * widening
        angle = self.begins_at + share * whole
        cos, sin = math.cos(angle), math.sin(angle)
        lift, lifting = self._lift(share)
        x, y, z = self.centre
        place = np.array([x + radius * cos, y + radius * sin, z + share * self.rise + lift])
        velocity = np.array(
            [
                widening * cos - radius * whole * sin,
                widening * sin + radius * whole * cos,
                self.rise + lifting,
            ]
        )
        return pin.SE3(self.rotation, place), velocity

    def _lift(self, share: float) -> tuple[float, float]:
        """Return how much is added to the height, and its derivative by the share."""
        gaps = len(self.raised) - 1
        place = min(int(share * gaps), gaps - 1)
        x = share * gaps - place
        low, high = float(self.raised[place]), float(self.raised[place + 1])
        blend = x**3 * (10 - 15 * x + 6 * x * x)
        slope = 30 * (x * (1 - x)) ** 2 * gaps
        return low + (high - low) * blend, (high - low) * slope

    def poses(self) -> list[TipPose]:
        """Return the way over its length, by Simpson's rule."""
        coarse = max(self.radius) * 2 * math.pi * abs(self.turns) + abs(self.rise)
        coarse += float(np.abs(np.diff(self.raised)).sum()) + abs(self.radius[1] - self.radius[0])
        # A whole number of poses between two points, so that no blend is cut in two.
        gaps = len(self.raised) - 1
        count = gaps * max(math.ceil(coarse / _EVERY_M / gaps), 2)
        shares = [i / count for i in range(count + 1)]
        rows = [self.at(share) for share in shares]
        speeds = [float(np.linalg.norm(velocity)) for _, velocity in rows]
        halves = [float(np.linalg.norm(self.at((i + 0.5) / count)[1])) for i in range(count)]
        poses, u = [], 0.0
        for i, (pose, velocity) in enumerate(rows):
            twist = np.concatenate([velocity / speeds[i], np.zeros(3)])
            poses.append(TipPose(u=u, pose=pose, twist=twist))
            if i < count:
                u += (speeds[i] + 4 * halves[i] + speeds[i + 1]) / (6 * count)
        return poses


def follow(
    robot: RobotModel, tip: str, way: Sequence[TipPose], start: Vector, singular_below: float
) -> JointPath:
    """Return the joints along a way of the tip, staying on the branch of their start.

    start: where the tip is at the first pose, shape (n,) [rad]. Between two poses the joints are
    predicted by the Jacobian, then corrected by Newton's method. Raises Lost with cause
    unreachable, limits or singular where the way leaves the branch.
    """
    tracer = _Tracer(robot, tip, singular_below)
    q, slope = start, np.zeros(len(start))
    rows: list[Vector] = []
    slopes: list[Vector] = []
    for place, pose in enumerate(way):
        ahead = pose.u - way[place - 1].u if place else 0.0
        try:
            q, slope = tracer.step(q, q + slope * ahead, pose)
        except Refused as exc:
            total = way[-1].u
            text = f"{exc} after {pose.u:.3f} of {total:.3f} m of the way"
            raise Lost(exc.cause, text, place) from exc
        rows.append(q)
        slopes.append(slope)
    u = np.array([pose.u for pose in way])
    return JointPath(u=u, q=np.array(rows), slope=np.array(slopes))


class _Tracer:
    def __init__(self, robot: RobotModel, tip: str, singular_below: float) -> None:
        self._robot = robot
        self._chain = robot.chain(tip)
        self._number = robot.frame_id(tip)
        self._least = singular_below

    def step(self, before: Vector, guess: Vector, wanted: TipPose) -> tuple[Vector, Vector]:
        """Return joints at a pose and their slope, from those before and a guess."""
        error = np.zeros(6)
        for q, jacobian, error in self._approach(guess, wanted.pose):
            if np.abs(q - before).max() > _LARGEST_STEP:
                self._check_singular(jacobian)
                raise Refused("singular", "singular: the joints would jump to another branch")
            if np.abs(error).max() < _CLOSE:
                self._check_singular(jacobian)
                both = _solved(jacobian, np.stack([error, wanted.twist], axis=1))
                end, slope = q.copy(), np.zeros(len(q))
                end[self._chain] += both[:, 0]
                slope[self._chain] = both[:, 1]
                self._check_limits(end)
                return end, slope
        miss = float(np.linalg.norm(error[:3])) * 1e3
        raise Refused("unreachable", f"unreachable: the tip stays {miss:.1f} mm away")

    def _approach(self, guess: Vector, pose: Any) -> Iterator[tuple[Vector, Vector, Vector]]:
        q = guess.copy()
        for _ in range(10):
            now, whole = self._robot.jacobian(q, self._number)
            turn = now.rotation @ pin.log3(now.rotation.T @ pose.rotation)
            error = np.concatenate([pose.translation - now.translation, turn])
            jacobian = whole[:, self._chain]
            yield q, jacobian, error
            q = q.copy()
            q[self._chain] += _solved(jacobian, error)

    def _check_singular(self, jacobian: Vector) -> None:
        least = float(np.linalg.svd(jacobian, compute_uv=False).min())
        if least < self._least:
            text = f"the smallest singular value falls to {least:.4f}, below {self._least:.4f},"
            raise Refused("singular", f"singular: {text}")

    def _check_limits(self, q: Vector) -> None:
        robot = self._robot
        beyond = np.maximum(robot.lower - q, q - robot.upper)
        worst = int(np.argmax(beyond))
        if beyond[worst] > 1e-9:
            raise Refused(
                "limits",
                f"out of limits: {robot.joints[worst]} would have to go to {q[worst]:.3f} rad, its "
                f"limits are [{robot.lower[worst]:.3f}, {robot.upper[worst]:.3f}],",
            )


def _solved(jacobian: Vector, twist: Vector) -> Vector:
    """Return the joint velocities of twists, shape (6,) or (6, k); jacobian: shape (6, m)."""
    if jacobian.shape[1] == 6:
        try:
            return np.asarray(np.linalg.solve(jacobian, twist), dtype=np.float64)
        except np.linalg.LinAlgError:
            pass
    return np.asarray(np.linalg.lstsq(jacobian, twist, rcond=None)[0], dtype=np.float64)
