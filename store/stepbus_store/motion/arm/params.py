"""The parameters of a controller that carries out goals of an arm."""

from collections.abc import Iterator
from typing import Literal

from stepbus_kinematics import Smoothing, smoothing_problems
from stepbus_participant import Count, File, NonNegative, Positive, PositivePerJoint, each
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
    time_constant: Positive | None = None
    """Time constant τ of the low-pass filter [s]; with `smoothing: low_pass`, and only then."""
    window: Count | None = None
    """Window of the moving average and of the Savitzky-Golay filter, and only of these: an odd
    number of samples, at least 3 or 5."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield contradictions between the filter and its parameters."""
        yield from smoothing_problems(self.smoothing, self.time_constant, self.window)
