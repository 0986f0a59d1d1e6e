"""Perception: a participant that detects items and their poses."""

from collections import deque
from collections.abc import Mapping

import cv2
import numpy as np

from stepbus_kinematics import JointOrder, RobotModel
from stepbus_participant import Config, Ports, Step, installed_version, parse_duration
from stepbus_schemas import (
    CameraTrigger,
    Description,
    Detections,
    Image,
    JointState,
    Message,
    Poses,
    RunError,
)
from stepbus_store.memory import Remembering
from stepbus_store.perception.detector import Detector
from stepbus_store.perception.images import make_view
from stepbus_store.perception.item_catalog import read_catalog, with_landmarks
from stepbus_store.perception.params import Params
from stepbus_store.perception.truth import Truth


class Perception(Remembering):
    """Publishes the type, pose and confidence of each item it detects.

    Inputs: two Image/1 of one camera, colour and depth; one JointState/1; one Poses/1, whose
    description lists the types of items, their shapes and colours; optionally, CameraTrigger/1,
    with the position to look at. Output: one Detections/1. Source camera: for each new pair of
    images, with the joint positions at the time of exposure, which the latency in the camera's
    description determines; the true poses are not used. Source truth: all items, once per period;
    only needs the poses. Parameters: see `Params`.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        ports = Ports(config)
        self._poses_port = ports.input_of("Poses/1")
        self._detections_port = ports.output_of("Detections/1")
        ports.outputs_are("Detections/1")
        self._request_port = ports.optional_input_of("CameraTrigger/1")
        self._images = [name for name, port in config.inputs.items() if port.type == "Image/1"]
        is_camera = config.param("source", "camera") == "camera"
        self._state_port = ports.input_of("JointState/1") if is_camera else ""
        if is_camera and len(self._images) != 2:
            text = f"{len(self._images)} ports have type Image/1; source camera needs two"
            ports.problems.add(("inputs",), f"{text}, colour and depth")
        params = self._params = config.read(Params, ports.problems)
        self._every = max(1, round(params.period * 1e9 / (config.step_ns * config.every)))
        self._robot: RobotModel | None = None
        if params.source == "camera" and params.model is not None:
            problems = config.problems().below(("params",))
            model, links = params.model, (params.frame, params.camera)
            self._robot = problems.attempt(
                ("model",), lambda: RobotModel(model, params.joints or (), links=links)
            )
            problems.refuse()
        # Joints and requests from the time on when the camera took what it puts out now.
        self._since: deque[tuple[JointState | None, CameraTrigger | None]] = deque(maxlen=1)

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Read the items from the description of the poses.

        Raises WiringError for poses without items, and for joints that are not sensed.
        """
        port, params, described = self._poses_port, self._params, inputs[self._poses_port]
        catalog = read_catalog(port, described)
        if self._robot is None:
            self._truth = Truth(port, described.names, catalog, params.frame, params.prefix)
        else:
            if params.landmark:
                name, radius = params.landmark, params.landmark_radius
                catalog = with_landmarks(catalog, port, described, name, radius)
            late = inputs[self._images[0]].details.get("latency")
            steps = parse_duration(late[0]) // self.config.step_ns if late else 0
            self._since = deque(maxlen=1 + steps // self.config.every)
            self._detector = Detector(catalog, params.min_confidence, params.depth_noise)
            joints = [params.prefix + joint for joint in self._robot.joints]
            self._order = JointOrder(self._state_port, inputs[self._state_port].names, joints)
        self.remember()

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return new detections when they are due."""
        if self._robot is None:
            poses = step.get(self._poses_port, Poses)
            due = (step.index // self.config.every) % self._every == 0
            detections = self._truth.detections(poses) if due and poses is not None else None
        else:
            detections = self._from_images(step, self._robot)
        return {} if detections is None else {self._detections_port: detections}

    def _from_images(self, step: Step, robot: RobotModel) -> Detections | None:
        """Return the items in new images, with the joints and the request of their exposure.

        Raises RunError for a request of a spot in another frame, and angles that are not finite.
        """
        port = self._request_port
        request = step.get(port, CameraTrigger) if port and step.is_new(port) else None
        self._since.append((step.get(self._state_port, JointState), request))
        if not all(map(step.is_new, self._images)):
            return None
        view = make_view({name: step.read(name, Image) for name in self._images})
        state, request = self._since[0]
        state = state or step.read(self._state_port, JointState)
        angles, frame = self._order.pick(state.position, "position"), self._params.frame
        if not np.isfinite(angles).all():
            raise RunError(f"input {self._state_port!r}: the angles {angles} rad must be finite")
        spot = request.position if request is not None else None
        if request is not None and spot is not None and request.frame != frame:
            text = f"the position to look at has the frame {request.frame!r}"
            raise RunError(f"{text}; it must be {frame!r}")
        base, camera = (robot.frame_pose(angles, name) for name in (frame, self._params.camera))
        items, hidden = self._detector.look(view, base.actInv(camera), spot)
        return Detections(
            frame=frame,
            types=[item.type for item in items],
            position=[item.position for item in items],
            orientation=[item.orientation for item in items],
            confidence=[item.confidence for item in items],
            hidden=hidden,
        )

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the result."""
        versions = {name: installed_version(name) for name in ("numpy", "pin")}
        if self._robot is not None:
            # OpenCV comes in packages with different names.
            versions["opencv"] = cv2.__version__
        return versions
