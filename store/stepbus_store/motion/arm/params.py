"""The parameters of a controller that carries out goals of an arm."""

from typing import Literal

from stepbus_participant import File, NonNegative, PositivePerJoint, each
from stepbus_store.motion.joint_params import JointParams


class Params(JointParams):
    """Parameters of `stepbus_store.motion.arm`."""

    prefix: str = ""
    """Prefix of this robot's joint names in the plant, such as `left/` if two bodies from one
    URDF share a world. Parameters and goals use the names in the URDF."""
    acceleration_limit: PositivePerJoint = each(4.0)
    """Acceleration limits [rad/s²]."""
    jerk_limit: PositivePerJoint = each(40.0)
    """Jerk limits [rad/s³]."""
    srdf: File | None = None
    """Lists the pairs of links that never or always collide; poses and motions with any other
    collision are refused. Default: collisions are not checked."""
    collision_margin: NonNegative = 0.01
    """Smallest distance between two links [m]."""
    not_holdable: Literal["refuse", "try"] = "refuse"
    """How to treat poses that the motors cannot hold."""
