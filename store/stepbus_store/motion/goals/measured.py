"""What was measured of a robot in a step."""

from dataclasses import dataclass

from stepbus_kinematics import Vector
from stepbus_schemas import BaseState, Contacts, GripperState

STANDING = BaseState(x=0.0, y=0.0, yaw=0.0, vx=0.0, wz=0.0)
"""Of a robot whose base does not move."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What was measured in a step.

    q, v, effort: of the arm's joints, shape (n,) [rad, rad/s, N·m]. effort, gripper, contacts: None
    where nothing senses them.
    """

    q: Vector
    v: Vector
    effort: Vector | None = None
    base: BaseState = STANDING
    gripper: GripperState | None = None
    contacts: Contacts | None = None
