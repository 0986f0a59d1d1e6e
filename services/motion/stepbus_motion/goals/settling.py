"""Tells when joints have come to rest where they shall be."""

from __future__ import annotations

import math

import numpy as np

from stepbus_kinematics import RobotModel, Vector

from .outcome import Outcome, Settling


class SettleWatch:
    """Watches the end of one motion.

    tip: frame whose distance from where it shall be is told.
    """

    def __init__(self, robot: RobotModel, settling: Settling, tip: str) -> None:
        self._robot = robot
        self._settling = settling
        self._tip = tip
        self._ended_at: float | None = None
        self._steps = 0

    def look(self, target: Vector, q: Vector, v: Vector, t: float) -> Outcome | None:
        """Return how it ended, once it has; to be called from the end of the motion on.

        target, q, v: where the joints shall be, are, and how fast, shape (n,) [rad, rad/s]. t: [s].
        """
        if self._ended_at is None:
            self._ended_at = t
        late, still = t - self._ended_at, self._settling
        worst = float(np.abs(target - q).max())
        is_there = worst <= still.position and float(np.abs(v).max()) <= still.velocity
        self._steps = self._steps + 1 if is_there else 0
        if self._steps >= still.steps:
            text = f"settled {late:.2f} s after the motion; {self._off(target, q)}"
            return Outcome(state="succeeded", text=text)
        if late < still.timeout:
            return None
        text = f"not settled {late:.2f} s after the motion: {self._off(target, q)}"
        return Outcome(state="failed", cause="not_settled", text=text)

    def _off(self, target: Vector, q: Vector) -> str:
        robot = self._robot
        error = target - q
        worst = int(np.argmax(np.abs(error)))
        wanted, got = (robot.frame_pose(joints, self._tip).translation for joints in (target, q))
        miss = float(np.linalg.norm(wanted - got)) * 1e3
        return (
            f"{robot.joints[worst]} is {math.degrees(error[worst]):.3f}° and {self._tip} "
            f"{miss:.2f} mm off"
        )
