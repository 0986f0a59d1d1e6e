"""Finds a joint that does not follow its command."""

import math

import numpy as np
from numpy.typing import NDArray

from stepbus_kinematics import RobotModel, Vector
from stepbus_store.motion.joint_motion import JointMotion

_FULL = 0.95
"""Share of the effort limit from which a motor gives all that it has."""


class JamWatch:
    """Compares what was commanded with what was measured a step later.

    lag: a joint that is further behind is jammed, or something holds it [rad, m]. period: between
    two commands [s].
    """

    def __init__(self, robot: RobotModel, lag: float, period: float) -> None:
        self._robot = robot
        self._lag, self._period = lag, period
        self._sent: Vector | None = None

    def command(self, sent: JointMotion) -> None:
        """Take what is commanded, and leads to the next measurement."""
        self._sent = sent.position + self._period * sent.velocity

    def stuck(self, q: Vector) -> NDArray[np.bool_]:
        """Return which joints do not follow, shape (n,) of bool; q: measured, shape (n,)."""
        if self._sent is None:
            return np.zeros(len(q), dtype=bool)
        return np.abs(self._sent - q) > self._lag

    def text(self, q: Vector, effort: Vector | None) -> str:
        """Return a sentence on the joint that is furthest behind; effort: measured [N·m, N]."""
        behind = np.zeros_like(q) if self._sent is None else self._sent - q
        worst = int(np.argmax(np.abs(behind)))
        joint, off = self._robot.joints[worst], float(abs(behind[worst]))
        slides = self._robot.unit(joint) == "m"
        text = f"{f'{1e3 * off:.0f} mm' if slides else f'{math.degrees(off):.1f}°'} behind"
        most = float(self._robot.effort_limit[worst])
        if effort is not None and abs(float(effort[worst])) > _FULL * most:
            text += f" at its limit of {most:.0f} {'N' if slides else 'N·m'}"
        return f"{joint} is {text}: is it jammed?"
