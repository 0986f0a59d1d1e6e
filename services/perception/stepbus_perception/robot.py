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


class JointReader:
    """Reads the angles of some joints, by name, from one port; see `JointOrder`."""

    def __init__(self, port: str, given: Sequence[str], wanted: Sequence[str]) -> None:
        self._port = port
        self._order = JointOrder(port, given, wanted)

    def read(self, state: JointState) -> list[float]:
        """Return the angles [rad], in the order wanted.

        Raises RunError for a state without them, or with one that is no finite number.
        """
        angles = self._order.pick(state.position, "position")
        if not np.isfinite(angles).all():
            raise RunError(f"input {self._port!r}: {angles} rad are not all finite numbers")
        read: list[float] = angles.tolist()
        return read
