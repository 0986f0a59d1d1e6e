"""The parameters of a controller that carries out goals of an arm."""

from collections.abc import Iterator
from typing import Literal

from stepbus_kinematics import Smoothing, TimeConstant, Window, window_problems
from stepbus_participant import File, NonNegative, PositivePerJoint, each
from stepbus_participant.parameters import Keys
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
    smoothing: Smoothing = "none"
    """Filter of the measurements. The status reports its delay."""
    time_constant: TimeConstant
    """Time constant τ of the low-pass filter [s]."""
    window: Window
    """Window: an odd number of samples, at least 3 for the moving average and 5 for the
    Savitzky-Golay filter."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong with the window."""
        yield from window_problems(self.smoothing, self.window)
