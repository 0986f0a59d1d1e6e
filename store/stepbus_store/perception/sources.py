"""Where detections come from: cameras, or the truth of the simulation."""

from collections.abc import Sequence
from pathlib import Path

from stepbus_kinematics import RobotModel, Vector
from stepbus_participant import suggest
from stepbus_schemas import Detections, Poses, WiringError
from stepbus_store.perception.images import Pose, inverse_times
from stepbus_store.perception.item_catalog import Catalog
from stepbus_store.poses import check_poses
from stepbus_store.solids import rotation


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

    def pose(self, angles: Vector) -> Pose:
        """Return where the camera is in the frame; angles: of the joints, shape (n,) [rad]."""
        frame, camera = (
            self._robot.frame_pose(angles, name) for name in (self._frame, self._camera)
        )
        pose = frame.actInv(camera)
        return Pose(rotation=pose.rotation.copy(), position=pose.translation.copy())


class Truth:
    """Turns true poses into detections of every item.

    port: name of the input with the poses, for messages. links: names of its links. frame: link
    that the detections are given in. prefix: what its name begins with among the links.
    Raises WiringError unless the frame is one of the links.
    """

    def __init__(
        self, port: str, links: Sequence[str], catalog: Catalog, frame: str, prefix: str = ""
    ) -> None:
        link = prefix + frame
        if link not in links:
            raise WiringError(f"input {port!r} has no link {link!r}{suggest(link, links)}")
        self._port = port
        self._links = list(links)
        self._name, self._frame = frame, links.index(link)
        self._items = [(links.index(link), name) for link, name in catalog.items.items()]
        self._centres = {item_type.name: item_type.centre for item_type in catalog.types}

    def detections(self, poses: Poses) -> Detections:
        """Return all items, in the order of the links, with confidence 1.

        Raises RunError for a wrong number of poses, and for an invalid one.
        """
        check_poses(self._port, self._links, poses)
        indices = [index for index, _ in self._items]
        origin, orientation = poses.position[self._frame], poses.orientation[self._frame]
        axes = rotation(orientation)
        centres = [
            poses.position[index]
            + rotation(poses.orientation[index]) @ self._centres[name]
            - origin
            for index, name in self._items
        ]
        return Detections(
            frame=self._name,
            types=[name for _, name in self._items],
            position=[tuple((centre @ axes).tolist()) for centre in centres],
            orientation=[inverse_times(orientation, poses.orientation[n]) for n in indices],
            confidence=[1.0] * len(indices),
        )
