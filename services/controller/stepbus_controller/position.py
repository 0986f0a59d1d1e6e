"""The parameters of a controller that commands positions."""

from typing import TYPE_CHECKING

from stepbus_participant import Names, NonNegativePerJoint, Settings, imported_later


class Params(Settings):
    """Parameters of `stepbus_controller.position`."""

    joints: Names
    """Joints under control, in the order of the commands."""
    prefix: str = ""
    """Prefix that the plant adds to the joint names of this robot: `left/` where two bodies of one
    URDF share a world. All other parameters name joints without it."""
    feed_forward: bool = True
    """Whether to command velocities; without them the joints lag behind."""
    effort_limit: NonNegativePerJoint | None = None
    """Torque limits of the motors [N·m]. Default: the plant's."""


if TYPE_CHECKING:
    from stepbus_controller.position_controller import PositionController

__all__ = ["Params", "PositionController"]

__getattr__ = imported_later("stepbus_controller", {"PositionController": "position_controller"})
