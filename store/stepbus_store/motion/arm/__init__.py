"""The parameters of a controller that carries out goals of an arm."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from stepbus_kinematics import Smoothing, TimeConstant, Window, window_problems
from stepbus_participant import File, NonNegative, PositivePerJoint, each, imported_later
from stepbus_participant.parameters import Keys
from stepbus_store.motion.joint_params import JointParams


class Params(JointParams):
    """Parameters of `stepbus_store.motion.arm`."""

    prefix: str = ""
    """What the plant puts before the names of this robot's joints: `left/` where two bodies of one
    URDF share a world. Parameters and goals name joints and links as the URDF does."""
    acceleration_limit: PositivePerJoint = each(4.0)
    """Largest accelerations [rad/s²]."""
    jerk_limit: PositivePerJoint = each(40.0)
    """Largest jerks [rad/s³]."""
    srdf: File | None = None
    """Names the pairs of links that never or always collide; poses and motions in which any other
    links touch are refused. Default: collisions are not checked."""
    collision_margin: NonNegative = 0.01
    """How close two links may come [m]."""
    not_holdable: Literal["refuse", "try"] = "refuse"
    """What happens with poses that the motors cannot hold."""
    smoothing: Smoothing = "none"
    """Filter of the measurements; the status reports its delay."""
    time_constant: TimeConstant
    """τ of the low pass [s]."""
    window: Window
    """Samples of the Savitzky-Golay filter, an odd number from 5 on."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong with the window."""
        yield from window_problems(self.smoothing, self.window)


if TYPE_CHECKING:
    from stepbus_store.motion.arm.arm_controller import ArmController

__all__ = ["ArmController", "Params"]

__getattr__ = imported_later(__name__, {"ArmController": "arm_controller"})
