"""How the arm must be stowed before the base moves."""

import math
from dataclasses import dataclass

from stepbus_kinematics import RobotModel, Vector

from .outcome import Refused


@dataclass(frozen=True, kw_only=True)
class StowCondition:
    """How the arm must be stowed before the base moves.

    frame: of the gripper. height: above the floor, at most [m]. reach: from the origin of the
    base, at most [m].
    """

    robot: RobotModel
    frame: str
    height: float
    reach: float

    def check(self, q: Vector) -> None:
        """Raise Refused where the frame is too high or too far out at q, shape (n,) [rad]."""
        position = self.robot.frame_pose(q, self.frame).translation
        if position[2] > self.height:
            raise Refused(
                "too_high",
                f"{self.frame} is {position[2]:.3f} m above the floor; the base moves only below "
                f"{self.height:g} m",
            )
        reach = math.hypot(position[0], position[1])
        if reach > self.reach:
            raise Refused(
                "too_far",
                f"{self.frame} reaches {reach:.3f} m out from the base, which moves only below "
                f"{self.reach:g} m",
            )
