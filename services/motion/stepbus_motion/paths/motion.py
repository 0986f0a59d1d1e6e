"""Joint motion from one pose to another within velocity and acceleration limits, by ruckig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import ruckig

from stepbus_kinematics import Vector
from stepbus_schemas import RunError


@dataclass(frozen=True, kw_only=True)
class MotionLimits:
    """Largest velocity, acceleration, jerk, each of shape (n,) [rad/s, rad/s², rad/s³]."""

    velocity: Vector
    acceleration: Vector
    jerk: Vector

    def slowed(self, factor: float) -> MotionLimits:
        """Return the limits of the same motion in `factor` of the time."""
        return MotionLimits(
            velocity=self.velocity / factor,
            acceleration=self.acceleration / factor**2,
            jerk=self.jerk / factor**3,
        )


@dataclass(frozen=True, kw_only=True)
class JointMotion:
    """Where the joints are: position, velocity, acceleration, shape (n,) [rad, rad/s, rad/s²]."""

    position: Vector
    velocity: Vector
    acceleration: Vector

    @classmethod
    def at_rest(cls, position: Vector) -> JointMotion:
        """Return joints that stand still at a position."""
        still = np.zeros_like(position)
        return cls(position=position, velocity=still, acceleration=still)


class Motion:
    """Motion to rest, all joints arriving at the same time; at its end it stays there.

    duration: [s].
    """

    def __init__(self, trajectory: Any) -> None:
        self._trajectory = trajectory
        self.duration: float = trajectory.duration

    def at(self, t: float) -> JointMotion:
        """Return the joints at a time since its beginning [s]."""
        if t >= self.duration:
            return JointMotion.at_rest(np.array(self._trajectory.at_time(self.duration)[0]))
        rows = self._trajectory.at_time(max(t, 0.0))
        position, velocity, acceleration = (np.array(row) for row in rows[:3])
        return JointMotion(position=position, velocity=velocity, acceleration=acceleration)


class Route:
    """Motions one after the other; duration: of all together [s]."""

    def __init__(self, motions: Sequence[Motion]) -> None:
        self._motions = list(motions)
        self.duration = sum(motion.duration for motion in motions)

    def at(self, t: float) -> JointMotion:
        """Return the joints at a time since the beginning [s]."""
        for motion in self._motions[:-1]:
            if t < motion.duration:
                return motion.at(t)
            t -= motion.duration
        return self._motions[-1].at(t)


def motion_to(
    start: JointMotion, goal: Vector, limits: MotionLimits, least_duration: float = 0.0
) -> Motion:
    """Return the fastest motion to rest at goal, shape (n,) [rad].

    From rest, the joints stay on the straight line between both. least_duration: it takes no less
    [s]. Raises RunError when there is no such motion.
    """
    given = _input(start, limits)
    given.target_position = goal.tolist()
    if not start.velocity.any() and not start.acceleration.any():
        given.synchronization = ruckig.Synchronization.Phase
    if least_duration > 0:
        given.minimum_duration = least_duration
    return _calculated(given)


def stop_from(start: JointMotion, limits: MotionLimits) -> Motion:
    """Return the fastest motion to a standstill, wherever that is.

    Raises RunError when there is none.
    """
    given = _input(start, limits)
    given.control_interface = ruckig.ControlInterface.Velocity
    given.synchronization = ruckig.Synchronization.No
    return _calculated(given)


def _input(start: JointMotion, limits: MotionLimits) -> Any:
    given = ruckig.InputParameter(len(start.position))
    given.current_position = start.position.tolist()
    given.current_velocity = start.velocity.tolist()
    given.current_acceleration = start.acceleration.tolist()
    given.max_velocity = limits.velocity.tolist()
    given.max_acceleration = limits.acceleration.tolist()
    given.max_jerk = limits.jerk.tolist()
    return given


def _calculated(given: Any) -> Motion:
    trajectory = ruckig.Trajectory(given.degrees_of_freedom)
    try:
        result = ruckig.Ruckig(given.degrees_of_freedom).calculate(given, trajectory)
    except (ruckig.RuckigError, ValueError) as exc:
        # A ValueError is a result that its Python side has no name for, as a duration of hours.
        raise RunError(f"ruckig has no motion within the limits: {exc}") from exc
    if result != ruckig.Result.Working:
        raise RunError(f"ruckig has no motion within the limits: {result}")
    return Motion(trajectory)
