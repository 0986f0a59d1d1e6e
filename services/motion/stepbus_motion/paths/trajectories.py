"""Ways of the joints over a parameter, and motions along them that the motors can follow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from stepbus_kinematics import RobotModel, Vector
from stepbus_motion.goals.outcome import Refused
from stepbus_schemas import Plan

from .motion import JointMotion, MotionLimits, motion_to

_CHECKED_EVERY_S = 0.04
"""Distance of the states of a motion whose torques are looked at [s]."""

_LEAST_CHECKED, _MOST_CHECKED = 100, 2000
"""States of a motion that are looked at, however quick or slow it is."""

_ROUNDING = 1e-6


class Trajectory(Protocol):
    """Joints over time, coming to rest; duration: [s]. After it they stay where they are."""

    duration: float

    def at(self, t: float) -> JointMotion:
        """Return the joints at a time since the beginning [s]."""
        ...


@dataclass(frozen=True, kw_only=True)
class JointPath:
    """Cubic Hermite interpolation of joint positions over a parameter u.

    u: shape (k,), increasing. q: shape (k, n) [rad]. slope: dq/du, shape (k, n).
    """

    u: Vector
    q: Vector
    slope: Vector

    @cached_property
    def _ends(self) -> Vector:
        """Return what each piece is made of: its ends and its tangents, shape (k - 1, 4, n)."""
        widths = np.diff(self.u)[:, np.newaxis]
        tangents = (widths * self.slope[:-1], widths * self.slope[1:])
        return np.stack([self.q[:-1], self.q[1:], *tangents], axis=1)

    def at(self, u: float) -> tuple[Vector, Vector, Vector]:
        """Return q, dq/du and d²q/du² at u, each of shape (n,); u is cut at both ends."""
        place = int(np.searchsorted(self.u, u, side="right")) - 1
        place = min(max(place, 0), len(self.u) - 2)
        width = float(self.u[place + 1] - self.u[place])
        x = min(max((u - float(self.u[place])) / width, 0.0), 1.0)
        one, two = 6 * x * (x - 1) / width, (12 * x - 6) / width**2
        blend = np.array(
            [
                [1 + x * x * (2 * x - 3), x * x * (3 - 2 * x), x * (1 - x) ** 2, x * x * (x - 1)],
                [one, -one, (1 + x * (3 * x - 4)) / width, x * (3 * x - 2) / width],
                [two, -two, (6 * x - 4) / width**2, (6 * x - 2) / width**2],
            ]
        )
        q, slope, curve = blend @ self._ends[place]
        return q, slope, curve


class AlongPath:
    """Motion along a path from rest to rest, its parameter timed by ruckig.

    limits: of the parameter, shape (1,) [1/s, 1/s², 1/s³].
    """

    def __init__(self, path: JointPath, limits: MotionLimits) -> None:
        self._path = path
        start = JointMotion.at_rest(path.u[:1].copy())
        self._timing = motion_to(start, path.u[-1:].copy(), limits)
        self.duration: float = self._timing.duration

    def at(self, t: float) -> JointMotion:
        """Return the joints at a time since the beginning [s]."""
        now = self._timing.at(t)
        u, speed, push = (float(row[0]) for row in (now.position, now.velocity, now.acceleration))
        q, slope, curve = self._path.at(u)
        return JointMotion(
            position=q, velocity=slope * speed, acceleration=curve * speed**2 + slope * push
        )


class Timed:
    """A path whose parameter is the time [s] from 0 on."""

    def __init__(self, path: JointPath) -> None:
        self._path = path
        self.duration: float = float(path.u[-1])

    def at(self, t: float) -> JointMotion:
        """Return the joints at a time since the beginning [s]."""
        if t >= self.duration:
            return JointMotion.at_rest(self._path.q[-1].copy())
        q, slope, curve = self._path.at(t)
        return JointMotion(position=q, velocity=slope, acceleration=curve)


class Stretched:
    """The same motion in `factor` times the time."""

    def __init__(self, trajectory: Trajectory, factor: float) -> None:
        self._trajectory = trajectory
        self._factor = factor
        self.duration: float = trajectory.duration * factor

    def at(self, t: float) -> JointMotion:
        """Return the joints at a time since the beginning [s]."""
        now = self._trajectory.at(t / self._factor)
        return scaled(now, 1.0 / self._factor)


class Joined:
    """Motions one after the other; each begins at rest where the one before ends."""

    def __init__(self, parts: Sequence[Trajectory]) -> None:
        self._parts = list(parts)
        self.duration: float = sum(part.duration for part in parts)

    def at(self, t: float) -> JointMotion:
        """Return the joints at a time since the beginning [s]."""
        for part in self._parts[:-1]:
            if t < part.duration:
                return part.at(t)
            t -= part.duration
        return self._parts[-1].at(t)


class Rest:
    """Standing still at positions of shape (n,) [rad]."""

    def __init__(self, q: Vector) -> None:
        self._now = JointMotion.at_rest(q.copy())
        self.duration: float = 0.0

    def at(self, t: float) -> JointMotion:
        """Return the joints at a time since the beginning [s]."""
        return self._now


def scaled(now: JointMotion, rate: float) -> JointMotion:
    """Return the joints of a motion whose time runs `rate` times as fast."""
    return JointMotion(
        position=now.position,
        velocity=now.velocity * rate,
        acceleration=now.acceleration * rate**2,
    )


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
        raise Refused("no_way", "there is no way to go: the arm is there already")
    q = np.array(kept)
    u = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])
    return JointPath(u=u, q=q, slope=np.gradient(q, u, axis=0))


def fitted(
    trajectory: Trajectory,
    robot: RobotModel,
    limits: MotionLimits,
    *,
    effort_share: float = 1.0,
    least_duration: float = 0.0,
) -> Trajectory:
    """Return a motion slowed down until it keeps the limits of velocity, acceleration and torque.

    In f times the time, velocities are 1/f, accelerations and dynamic torques 1/f² (Hollerbach,
    Dynamic Scaling of Manipulator Trajectories, 1984). least_duration: it takes no less [s].
    Raises Refused where standing still on the way is beyond `effort_share` of the effort limits.
    """
    states = _sampled(trajectory)
    fast = max(float((np.abs(state.velocity) / limits.velocity).max()) for state in states)
    hard = max(float((np.abs(state.acceleration) / limits.acceleration).max()) for state in states)
    heavy = _torque_factor(states, robot, effort_share)
    factor = max(fast, math.sqrt(hard), heavy)
    # States between those that were looked at may be a little worse; a motion that ruckig has
    # timed is at its limits up to rounding.
    factor = factor * 1.01 if factor > 1.0 + _ROUNDING else 1.0
    if trajectory.duration > 0:
        factor = max(factor, least_duration / trajectory.duration)
    return Stretched(trajectory, factor) if factor > 1.0 else trajectory


def is_strong_enough(trajectory: Trajectory, robot: RobotModel) -> bool:
    """Return whether the motors have the torque for a motion."""
    try:
        return _torque_factor(_sampled(trajectory), robot, 1.0) <= 1.0
    except Refused:
        return False


def _torque_factor(states: Sequence[JointMotion], robot: RobotModel, share: float) -> float:
    """Return in how many times the time the motors are strong enough."""
    limit = robot.effort_limit * share
    # An arm that hangs in its motors' limits has to be allowed to leave.
    limit = np.maximum(limit, 1.02 * np.abs(robot.gravity_torque(states[0].position)))
    factor = 1.0
    for state in states:
        static = robot.gravity_torque(state.position)
        if (np.abs(static) > limit).any():
            worst = int(np.argmax(np.abs(static) - limit))
            text = f"{robot.joints[worst]} needs {abs(static[worst]):.1f} N·m on the way"
            raise Refused("not_holdable", f"not holdable: {text} and has {limit[worst]:.1f} N·m")
        whole = robot.inverse_dynamics(state.position, state.velocity, state.acceleration)
        moving = whole - static
        room = np.maximum(limit - np.sign(moving) * static, 1e-9)
        factor = max(factor, math.sqrt(float((np.abs(moving) / room).max())))
    return factor


def _sampled(trajectory: Trajectory) -> list[JointMotion]:
    count = math.ceil(trajectory.duration / _CHECKED_EVERY_S)
    count = min(max(count, _LEAST_CHECKED), _MOST_CHECKED)
    return [trajectory.at(trajectory.duration * i / count) for i in range(count + 1)]


def planned(
    plan: Plan, start: Vector, goal: Vector, robot: RobotModel, *, tolerance: float = 1e-3
) -> Timed:
    """Return the motion of a plan, cubic between its samples.

    start, goal: where it has to begin and to end, shape (n,) [rad], within `tolerance` [rad].
    Raises Refused with cause bad_plan for one that is of no use.
    """
    if (problem := _shape_problem(plan, len(robot.joints))) is not None:
        raise Refused("bad_plan", f"plan {plan.id} {problem}")
    u, q, slope = (
        np.array(row, dtype=np.float64) for row in (plan.times, plan.position, plan.velocity)
    )
    for name, wanted, got in (("start", start, q[0]), ("end", goal, q[-1])):
        worst = int(np.argmax(np.abs(got - wanted)))
        if abs(got[worst] - wanted[worst]) > tolerance:
            raise Refused(
                "bad_plan",
                f"plan {plan.id} has its {name} at {got[worst]:.4f} rad for {robot.joints[worst]}, "
                f"not at {wanted[worst]:.4f} rad",
            )
    beyond = np.maximum(robot.lower - q, q - robot.upper).max(axis=0)
    if beyond.max() > tolerance:
        worst = int(np.argmax(beyond))
        text = f"{robot.joints[worst]} {beyond[worst]:.4f} rad beyond its limits"
        raise Refused("bad_plan", f"plan {plan.id} takes {text}")
    # From exactly where the arm is: the error of rounding fades on the way.
    share = (u / u[-1])[:, np.newaxis]
    q += (1.0 - share) * (start - q[0]) + share * (goal - q[-1])
    return Timed(JointPath(u=u, q=np.clip(q, robot.lower, robot.upper), slope=slope))


def _shape_problem(plan: Plan, joints: int) -> str | None:
    counts = {len(plan.times), len(plan.position), len(plan.velocity)}
    if len(counts) != 1 or len(plan.times) < 2:
        rows = f"{len(plan.times)} times, {len(plan.position)} positions"
        return f"has {rows} and {len(plan.velocity)} velocities, at least 2 of each are needed"
    if any(len(row) != joints for row in (*plan.position, *plan.velocity)):
        return f"has a row that is not of {joints} joints"
    numbers = [*plan.times, *(x for row in (*plan.position, *plan.velocity) for x in row)]
    if not all(map(math.isfinite, numbers)):
        return "has numbers that are not finite"
    gaps = [b - a for a, b in zip(plan.times, plan.times[1:], strict=False)]
    if plan.times[0] != 0 or min(gaps) <= 0:
        return "has times that do not increase from 0"
    if max(abs(x) for row in (plan.velocity[0], plan.velocity[-1]) for x in row) > 1e-3:
        return "does not begin and end at rest"
    return None
