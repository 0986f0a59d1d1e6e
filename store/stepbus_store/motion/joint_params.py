"""Parameters of all that controls joints."""

from stepbus_participant import Count, ModelFile, Names, Positive, PositivePerJoint, Settings


class JointParams(Settings):
    """The joints of an arm, and when a motion counts as done."""

    model: ModelFile
    """URDF or xacro of the robot."""
    joints: Names
    """Joints of the arm; all others stay at their neutral position."""
    velocity_limit: PositivePerJoint | None = None
    """Velocity limits [rad/s]. Default: 80 % of the URDF's."""
    settle_position: Positive = 1e-3
    """Largest error of a joint at the end of a motion [rad]."""
    settle_velocity: Positive = 1e-2
    """Largest velocity that counts as at rest [rad/s]."""
    settle_steps: Count = 5
    """Number of consecutive steps for which both must hold."""
    settle_timeout: Positive = 3.0
    """Timeout for that, from the end of the motion [s]."""
