"""Where detections come from: cameras, or the truth of the simulation."""

import importlib.util
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from stepbus_kinematics import JointOrder, RobotModel
from stepbus_participant import Config, Ports, Problems, extra_hint, suggest
from stepbus_schemas import Detections, JointState, Poses, RunError, WiringError
from stepbus_store.perception.images import Pose, Vector, inverse_times, rotation
from stepbus_store.perception.item_catalog import Catalog
from stepbus_store.perception.params import Params


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
        raise RunError(f"input {port!r}: the angles {angles} rad must be finite")
    read: list[float] = angles.tolist()
    return read


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
        count = len(self._links)
        if len(poses.position) != count or len(poses.orientation) != count:
            raise RunError(
                f"input {self._port!r}: expected {count} poses, received {len(poses.position)}"
            )
        indices = [index for index, _ in self._items]
        self._check(poses, [self._frame, *indices])
        origin, orientation = poses.position[self._frame], poses.orientation[self._frame]
        axes = rotation(orientation)
        centres = [self._centre(poses, index, name) - origin for index, name in self._items]
        return Detections(
            frame=self._name,
            types=[name for _, name in self._items],
            position=[tuple((centre @ axes).tolist()) for centre in centres],
            orientation=[inverse_times(orientation, poses.orientation[n]) for n in indices],
            confidence=[1.0] * len(indices),
        )

    def _check(self, poses: Poses, indices: Sequence[int]) -> None:
        """Raise RunError for a pose that is not finite or has a zero quaternion."""
        for index in indices:
            position, orientation = poses.position[index], poses.orientation[index]
            if not (math.isfinite(sum(position)) and 0.0 < math.hypot(*orientation) < math.inf):
                raise RunError(
                    f"input {self._port!r}: {self._links[index]} has an invalid pose: "
                    f"position {position}, orientation {orientation}"
                )

    def _centre(self, poses: Poses, index: int, item_type: str) -> Vector:
        """Return the centre of an item in the world, shape (3,) [m]."""
        offset = rotation(poses.orientation[index]) @ self._centres[item_type]
        centre: Vector = poses.position[index] + offset
        return centre


_IMAGE = "Image/1"


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """How to find items in images.

    images: the two input ports. joint_state: input port; request: that of requests, None: there is
    none. mount: where the camera is.
    """

    images: tuple[str, str]
    joint_state: str
    request: str | None
    mount: CameraMount
    params: Params


class PerceptionSettings:
    """What the scenario's params and ports say; raises SettingsError.

    camera: how to find items in images; None: the truth of the simulation is published, every
    `every` steps of the participant.
    """

    def __init__(self, config: Config) -> None:
        ports = Ports(config)
        self.poses = ports.input_of("Poses/1")
        self.detections = ports.output_of("Detections/1")
        ports.outputs_are("Detections/1")
        is_camera = config.param("source", "camera") == "camera"
        images = _images(config, ports.problems) if is_camera else ("", "")
        joint_state = ports.input_of("JointState/1") if is_camera else ""
        request = ports.optional_input_of("CameraTrigger/1")
        self.params = params = config.read(Params, ports.problems)
        self.every = max(1, round(params.period * 1e9 / (config.step_ns * config.every)))
        self.camera: CameraSettings | None = None
        if params.source == "camera":
            self.camera = CameraSettings(
                images=images,
                joint_state=joint_state,
                request=request,
                mount=_mount(config, params),
                params=params,
            )


def _images(config: Config, problems: Problems) -> tuple[str, str]:
    """Return the ports of the images, identified by their descriptions."""
    images = [name for name, port in config.inputs.items() if port.type == _IMAGE]
    if len(images) != 2:
        text = f"{len(images)} ports have type {_IMAGE}; source camera needs two, colour and depth"
        problems.add(("inputs",), text)
        return ("", "")
    return (images[0], images[1])


def _mount(config: Config, params: Params) -> CameraMount:
    problems = config.problems().below(("params",))
    if importlib.util.find_spec("cv2") is None:
        text = f"camera needs cv2 (OpenCV), which is not installed{extra_hint('cv2')}"
        problems.add(("source",), text)
    # The checks of the parameters make sure of both.
    model, joints = cast("Path", params.model), params.joints or ()
    mount = problems.attempt(
        ("model",), lambda: CameraMount(model, joints, params.camera, params.frame)
    )
    if mount is None or len(problems):
        raise problems.error()
    return mount
