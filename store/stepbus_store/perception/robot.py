"""Where the camera is, by forward kinematics."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stepbus_kinematics import JointOrder, RobotModel
from stepbus_schemas import JointState, RunError

from .geometry import Pose


class CameraMount:
    """A camera on a robot.

    path: URDF or xacro. joints: those that move the camera; all others stand at neutral. camera:
    link, its optical frame. frame: link that the camera's pose is given in, z up.
    Raises WiringError that lists all that the model lacks.
    """

    def __init__(self, path: Path, joints: Sequence[str], camera: str, frame: str) -> None:
        self._robot = RobotModel(path, joints, links=(frame, camera))
        self._camera, self._frame = camera, frame
        self.joints = self._robot.joints

    def pose(self, angles: Sequence[float]) -> Pose:
        """Return where the camera is in the frame; angles: of the joints, in their order [rad]."""
        q = np.array(angles, dtype=np.float64)
        frame, camera = (self._robot.frame_pose(q, name) for name in (self._frame, self._camera))
        pose = frame.actInv(camera)
        return Pose(rotation=pose.rotation.copy(), position=pose.translation.copy())


def read_angles(order: JointOrder, port: str, state: JointState) -> list[float]:
    """Return the angles in an order [rad]; port: where they come from.

    Raises RunError for a state without them, or with one that is no finite number.
    """
    angles = order.pick(state.position, "position")
    if not np.isfinite(angles).all():
        raise RunError(f"input {port!r}: {angles} rad are not all finite numbers")
    read: list[float] = angles.tolist()
    return read
