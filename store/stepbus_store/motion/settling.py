"""Watches joints: whether they follow their commands, and have settled at the end of a motion."""

import math

import numpy as np
from numpy.typing import NDArray

from stepbus_kinematics import RobotModel, Vector
from stepbus_store.cause import Cause
from stepbus_store.motion.joint_motion import JointMotion
from stepbus_store.motion.joint_params import JointParams
from stepbus_store.motion.outcome import Outcome
from stepbus_store.motion.trajectory import Trajectory


class SettleWatch:
    """Watches the joints that a motion moves, from its end on; tip: its error is reported, too."""

    def __init__(
        self, robot: RobotModel, settling: JointParams, trajectory: Trajectory, tip: str = ""
    ) -> None:
        self._robot = robot
        self._settling = settling
        self._tip = tip
        self._target = trajectory.at(trajectory.duration).position
        shift = self._target - trajectory.at(0.0).position
        self._moved = np.flatnonzero(shift) if shift.any() else np.arange(len(shift))
        self._steps = 0

    def check(self, q: Vector, v: Vector, late: float) -> Outcome | None:
        """Return how the motion ended, once it has.

        q, v: measured, shape (n,) [rad, rad/s]. late: time since the end of the motion [s].
        """
        settling, error = self._settling, (self._target - q)[self._moved]
        is_there = float(np.abs(error).max()) <= settling.settle_position
        is_still = float(np.abs(v[self._moved]).max()) <= settling.settle_velocity
        self._steps = self._steps + 1 if is_there and is_still else 0
        if self._steps >= settling.settle_steps:
            text = f"settled {late:.2f} s after the motion; {self._off(error, q)}"
            return Outcome(state="succeeded", text=text)
        if late < settling.settle_timeout:
            return None
        text = f"not settled {late:.2f} s after the motion: {self._off(error, q)}"
        return Outcome(state="failed", cause=Cause.NOT_SETTLED, text=text)

    def _off(self, error: Vector, q: Vector) -> str:
        worst = int(np.argmax(np.abs(error)))
        joint, off = self._robot.joints[self._moved[worst]], float(error[worst])
        text = f"{joint} is {_shown(self._robot, joint, off, 3)}"
        if not self._tip:
            return f"{text} off"
        wanted, got = (self._robot.frame_pose(x, self._tip).translation for x in (self._target, q))
        miss = float(np.linalg.norm(wanted - got)) * 1e3
        return f"{text} and {self._tip} {miss:.2f} mm off"


def _shown(robot: RobotModel, joint: str, off: float, digits: int) -> str:
    if robot.unit(joint) == "m":
        return f"{1e3 * off:.{digits}f} mm"
    return f"{math.degrees(off):.{digits}f}°"


_FULL = 0.95
"""Share of the effort limit from which a motor gives all that it has."""

_LASTING, _PATIENCE = 0.05, 1.0
"""Share of the lag that counts, too, once it has lasted so long [s]."""


class JamWatch:
    """Compares what was commanded with what was measured a step later.

    lag: a joint that is further behind is jammed, or something holds it [rad, m]. period: between
    two commands [s].
    """

    def __init__(self, robot: RobotModel, lag: float, period: float) -> None:
        self._robot = robot
        self._lag, self._period = lag, period
        self._sent: Vector | None = None
        self._behind = self._late = np.zeros(len(robot.joints))

    def command(self, sent: JointMotion) -> None:
        """Store the command that leads to the next measurement."""
        self._sent = sent.position + self._period * sent.velocity

    def stuck(self, q: Vector) -> NDArray[np.bool_]:
        """Return which joints do not follow, shape (n,) of bool; q: measured, shape (n,)."""
        if self._sent is None:
            return np.zeros(len(q), dtype=bool)
        behind = self._behind = np.abs(self._sent - q)
        self._late = np.where(behind > _LASTING * self._lag, self._late + self._period, 0.0)
        return (behind > self._lag) | (self._late >= _PATIENCE)

    def text(self, effort: Vector | None) -> str:
        """Return a sentence on the joint that is furthest behind; effort: measured [N·m, N]."""
        worst = int(np.argmax(self._behind))
        joint = self._robot.joints[worst]
        text = f"{_shown(self._robot, joint, float(self._behind[worst]), 1)} behind"
        most = float(self._robot.effort_limit[worst])
        if effort is not None and abs(float(effort[worst])) > _FULL * most:
            text += f" at its limit of {most:.0f} {self._robot.effort_unit(joint)}"
        return f"{joint} is {text}: is it jammed?"
