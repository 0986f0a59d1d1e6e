"""The parameters of the world model."""

from typing import TYPE_CHECKING

from stepbus_participant import Duration, ModelFile, Names, Positive, Settings, Text, imported_later


class Drift(Settings):
    """Standard deviations of what odometry does not notice."""

    distance: Positive = 0.02
    """Of the position, after 1 m; it grows with the root of the distance [m]."""
    heading: Positive = 0.02
    """Of the heading, after 1 m, likewise [rad]."""
    turn: Positive = 0.03
    """Of the heading, after a turn by 1 rad, likewise [rad]."""


class Params(Settings):
    """Parameters of `stepbus_store.world_model`."""

    model: ModelFile
    """URDF or xacro of the robot."""
    joints: Names
    """Joints of the arm, in any order."""
    prefix: str = ""
    """What the plant puts before this robot's names: `left/` where two bodies of one URDF share
    a world. All other parameters name joints and links without it."""
    fingers: Names = ("left_finger", "right_finger")
    """The two joints of the gripper; each moves by half of its width."""
    frame: Text = "chassis"
    """Root link of the robot; odometry and detections are about it."""
    tip: Text = "grasp"
    """Link that a held item moves with."""
    landmark: Text = "landmark"
    """Type of the detections of landmarks, and how the names of their links begin."""
    period_ns: Duration = 48_000_000
    """Between two outputs of the poses; rounded to whole steps of the participant."""
    start: Positive = 0.01
    """Standard deviation of the pose at the start [m, rad]."""
    drift: Drift = Drift()
    """What odometry does not notice."""
    landmark_noise: Positive = 0.003
    """Standard deviation of where the camera sees a landmark [m]."""
    farthest: Positive = 0.08
    """Farther from where a landmark is expected, a detection is not that landmark [m]."""
    same: Positive = 0.05
    """Farther from where an item is expected, a detection is not that item [m]."""


if TYPE_CHECKING:
    from stepbus_store.world_model.world_model import WorldModel

__all__ = ["Params", "WorldModel"]

__getattr__ = imported_later(__name__, {"WorldModel": "world_model"})
