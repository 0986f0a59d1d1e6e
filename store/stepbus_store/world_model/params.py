"""The parameters of the world model."""

from stepbus_participant import Duration, ModelFile, Names, Positive, Settings, Text


class Drift(Settings):
    """Standard deviations of the errors of odometry."""

    distance: Positive = 0.02
    """Standard deviation of the position after 1 m; it grows with the square root of the
    distance [m]."""
    heading: Positive = 0.02
    """Standard deviation of the heading after 1 m; it grows likewise [rad]."""
    turn: Positive = 0.03
    """Standard deviation of the heading after a turn by 1 rad; it grows likewise [rad]."""


class Params(Settings):
    """Parameters of `stepbus_store.world_model`."""

    model: ModelFile
    """URDF or xacro of the robot."""
    joints: Names
    """Joints of the arm, in any order."""
    prefix: str = ""
    """Prefix of this robot's names in the plant, such as `left/` if two bodies from one URDF
    share a world. All other parameters name joints and links without it."""
    fingers: Names = ("left_finger", "right_finger")
    """The two joints of the gripper; each moves by half the width."""
    frame: Text = "chassis"
    """Root link of the robot, the reference of odometry and detections."""
    tip: Text = "grasp"
    """Link that a held item moves with."""
    landmark: Text = "landmark"
    """Type of the landmarks in the detections; their link names begin with it."""
    period_ns: Duration = 48_000_000
    """Period of the poses, rounded to whole steps of the participant."""
    start: Positive = 0.01
    """Standard deviation of the pose at the start [m, rad]."""
    drift: Drift = Drift()
    """Errors of the odometry."""
    landmark_noise: Positive = 0.003
    """Standard deviation of a detected landmark's position [m]."""
    farthest: Positive = 0.08
    """Distance from the expected position beyond which a detection is not that landmark [m]."""
    same: Positive = 0.05
    """Distance from the expected position beyond which a detection is not that item [m]."""
