"""A controller that commands positions, with its parameters."""

from stepbus_participant import Names, NonNegativePerJoint, Settings, imported_later

__getattr__ = imported_later("stepbus_controller", {"PositionController": "position_controller"})


class Params(Settings):
    """Parameters of `stepbus_controller.position`."""

    joints: Names
    """Controlled joints, in the order of the commands."""
    prefix: str = ""
    """Prefix of this robot's joint names in the plant, such as `left/` if two bodies from one
    URDF share a world. All other parameters name joints without it."""
    feed_forward: bool = True
    """Whether to command velocities too; without them, the joints lag behind."""
    effort_limit: NonNegativePerJoint | None = None
    """Torque limits of the motors [N·m]. Default: the plant's."""
