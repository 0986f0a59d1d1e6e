"""Joint motion to a goal within velocity, acceleration and jerk limits, by ruckig."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import ruckig
from numpy.typing import NDArray

from stepbus_kinematics import Vector
from stepbus_schemas import JointCommand
from stepbus_store.cause import Cause
from stepbus_store.motion.outcome import Refused


@dataclass(frozen=True, kw_only=True)
class MotionLimits:
    """Largest velocity, acceleration, jerk, each of shape (n,) [rad/s, rad/s², rad/s³]."""

    velocity: Vector
    acceleration: Vector
    jerk: Vector

    @classmethod
    def of_one(cls, velocity: float, acceleration: float, jerk: float) -> MotionLimits:
        """Return the limits of a single coordinate, shape (1,)."""
        v, a, j = (np.array([limit]) for limit in (velocity, acceleration, jerk))
        return cls(velocity=v, acceleration=a, jerk=j)

    def at_least(self, acceleration: float, jerk: float) -> MotionLimits:
        """Return these limits, with none of acceleration and jerk smaller than the given ones."""
        return MotionLimits(
            velocity=self.velocity,
            acceleration=np.maximum(self.acceleration, acceleration),
            jerk=np.maximum(self.jerk, jerk),
        )


_TIP_TURNING = 1.0
"""Fastest turn of the tip [rad/s]."""


@dataclass(frozen=True, kw_only=True)
class ManipulatorOptions:
    """How an arm moves.

    period: between two commands [s]. tip: frame whose path counts when the arm backs off, and whose
    error is reported; empty: errors of joints only. tip_velocity, tip_acceleration, tip_jerk: of
    lines and spirals [m/s, m/s², m/s³]. plan_timeout: for the planner's answer [s of simulation].
    effort_share: of the effort limits that motions may need. brake_acceleration, brake_jerk: of the
    hardest stop; the limits of the motion where they are larger [rad/s², rad/s³]. jam_lag: a joint
    that is further behind its command is jammed [rad, m].
    """

    period: float
    tip: str
    tip_velocity: float = 0.25
    tip_acceleration: float = 0.5
    tip_jerk: float = 5.0
    plan_timeout: float = 5.0
    effort_share: float = 0.9
    brake_acceleration: float = 15.0
    brake_jerk: float = 1000.0
    jam_lag: float = math.inf

    @property
    def turn_radius(self) -> float:
        """Return the length that a turn of 1 rad counts on a path of the tip [m]."""
        return self.tip_velocity / _TIP_TURNING

    @property
    def tip_limits(self) -> MotionLimits:
        """Return the limits along a path of the tip, shape (1,) [m/s, m/s², m/s³]."""
        return MotionLimits.of_one(self.tip_velocity, self.tip_acceleration, self.tip_jerk)


@dataclass(frozen=True, kw_only=True)
class JointMotion:
    """Position, velocity, acceleration of joints, shape (n,) [rad, rad/s, rad/s²]."""

    position: Vector
    velocity: Vector
    acceleration: Vector

    @classmethod
    def at_rest(cls, position: Vector) -> JointMotion:
        """Return joints that stand still at a position, shape (n,) [rad]."""
        still = np.zeros_like(position)
        return cls(position=position, velocity=still, acceleration=still)

    @classmethod
    def of_one(cls, position: float, velocity: float, acceleration: float) -> JointMotion:
        """Return the motion of a single coordinate, shape (1,)."""
        q, v, a = (np.array([value]) for value in (position, velocity, acceleration))
        return cls(position=q, velocity=v, acceleration=a)

    def command(self) -> JointCommand:
        """Return the command for position motors with feed-forward velocity."""
        position, velocity = self.position.tolist(), self.velocity.tolist()
        return JointCommand(mode="position", values=position, velocity=velocity)

    @property
    def is_moving(self) -> bool:
        """Return whether any joint moves or accelerates."""
        return bool(self.velocity.any() or self.acceleration.any())

    def without(self, stuck: NDArray[np.bool_], q: Vector) -> JointMotion:
        """Return the motion with some joints at rest; stuck: which, shape (n,). q: where [rad]."""
        return JointMotion(
            position=np.where(stuck, q, self.position),
            velocity=np.where(stuck, 0.0, self.velocity),
            acceleration=np.where(stuck, 0.0, self.acceleration),
        )

    def scaled(self, rate: float) -> JointMotion:
        """Return the same motion with its time running `rate` times as fast."""
        return JointMotion(
            position=self.position,
            velocity=self.velocity * rate,
            acceleration=self.acceleration * rate**2,
        )


class Motion:
    """A motion to rest, the fastest one; after it they stay there.

    goal: None: wherever they come to rest. From rest, the joints stay on the straight line to it.
    duration: [s]; at least `least_duration` [s]. Raises Refused with cause no_path where no motion
    keeps the limits.
    """

    def __init__(
        self, start: JointMotion, goal: Vector | None, limits: MotionLimits, least_duration: float
    ) -> None:
        self.made_from = start, goal, limits, least_duration
        given = ruckig.InputParameter(len(start.position))
        given.current_position = start.position.tolist()
        given.current_velocity = start.velocity.tolist()
        given.current_acceleration = start.acceleration.tolist()
        given.max_velocity = limits.velocity.tolist()
        given.max_acceleration = limits.acceleration.tolist()
        given.max_jerk = limits.jerk.tolist()
        if goal is None:
            given.control_interface = ruckig.ControlInterface.Velocity
            given.synchronization = ruckig.Synchronization.No
        else:
            given.target_position = goal.tolist()
            if not start.is_moving:
                given.synchronization = ruckig.Synchronization.Phase
        if least_duration > 0:
            given.minimum_duration = least_duration
        self._trajectory = _calculated(given)
        self.duration: float = self._trajectory.duration
        self._latest: tuple[float, JointMotion] | None = None

    def at(self, t: float) -> JointMotion:
        """Return the joints at a time since its start [s]; a step asks several times for one."""
        if self._latest is None or self._latest[0] != t:
            self._latest = t, self._at(t)
        return self._latest[1]

    def _at(self, t: float) -> JointMotion:
        if t >= self.duration:
            return JointMotion.at_rest(np.array(self._trajectory.at_time(self.duration)[0]))
        rows = self._trajectory.at_time(max(t, 0.0))
        position, velocity, acceleration = (np.array(row) for row in rows[:3])
        return JointMotion(position=position, velocity=velocity, acceleration=acceleration)


def motion_to(
    start: JointMotion, goal: Vector, limits: MotionLimits, least_duration: float = 0.0
) -> Motion:
    """Return the fastest motion to rest at goal, shape (n,) [rad], see `Motion`."""
    return Motion(start, goal, limits, least_duration)


def stop_from(start: JointMotion, limits: MotionLimits) -> Motion:
    """Return the fastest motion to a standstill, wherever that is, see `Motion`."""
    return Motion(start, None, limits, 0.0)


def _calculated(given: Any) -> Any:
    trajectory = ruckig.Trajectory(given.degrees_of_freedom)
    try:
        result = ruckig.Ruckig(given.degrees_of_freedom).calculate(given, trajectory)
    except (ruckig.RuckigError, ValueError) as exc:
        # A ValueError is a result that its Python side has no name for, as a duration of hours.
        raise Refused(Cause.NO_PATH, f"ruckig finds no motion within the limits: {exc}") from exc
    if result != ruckig.Result.Working:
        raise Refused(Cause.NO_PATH, f"ruckig finds no motion within the limits: {result}")
    return trajectory
