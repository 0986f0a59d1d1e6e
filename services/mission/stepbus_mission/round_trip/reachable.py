"""Random poses that a robot can reach."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stepbus_kinematics import RobotModel
from stepbus_schemas import RunError, WiringError


class ReachablePoses:
    """Draws reachable poses of a robot from joint positions within its limits.

    path: URDF. frame: that the poses are given in. seed: of the draw.
    Raises WiringError for a file that is not a URDF, or an unknown frame.
    """

    def __init__(self, path: Path, frame: str, seed: int) -> None:
        self._robot = RobotModel(path)
        self._frame = frame
        self._random = np.random.Generator(np.random.PCG64(seed))
        self.check([frame])

    def check(self, tips: Sequence[str]) -> None:
        """Raise WiringError for unknown frames."""
        try:
            for tip in tips:
                self._robot.frame_id(tip)
        except RunError as exc:
            raise WiringError(str(exc)) from exc

    def draw(self, tip: str) -> Any:
        """Return a pose of a frame, as `pinocchio.SE3`; joints that do not move it are neutral."""
        robot = self._robot
        q = np.zeros(len(robot.joints))
        for index in robot.chain(tip):
            q[index] = self._random.uniform(robot.lower[index], robot.upper[index])
        return robot.frame_pose(q, self._frame).actInv(robot.frame_pose(q, tip))
