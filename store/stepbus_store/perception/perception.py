"""Perception: a participant that detects items and their poses."""

import logging
from collections import deque
from collections.abc import Mapping

from stepbus_kinematics import JointOrder
from stepbus_participant import Config, Participant, Step, installed_version, parse_duration
from stepbus_schemas import (
    CameraTrigger,
    Description,
    Detections,
    Image,
    JointState,
    Message,
    Poses,
    RunError,
    WiringError,
)
from stepbus_store.perception.images import View, make_view
from stepbus_store.perception.item_catalog import Catalog, read_catalog, with_landmarks
from stepbus_store.perception.sources import (
    CameraSettings,
    PerceptionSettings,
    Truth,
    read_angles,
)

_log = logging.getLogger("stepbus_store.perception")


class CameraSource:
    """Detects items in images of a camera on a robot.

    catalog: the items to detect. described: the description of the joint states.
    """

    def __init__(self, settings: CameraSettings, catalog: Catalog, described: Description) -> None:
        # Source truth works without OpenCV.
        from stepbus_store.perception.detector import Detector  # noqa: PLC0415

        params = settings.params
        self._frame = params.frame
        self._mount = settings.mount
        self._detector = Detector(catalog, params.min_confidence, params.depth_noise)
        self._port = settings.joint_state
        joints = [params.prefix + joint for joint in settings.mount.joints]
        self._order = JointOrder(self._port, described.names, joints)

    def detections(
        self, view: View, state: JointState, request: CameraTrigger | None = None
    ) -> Detections:
        """Return the items in a view; state: the joints at its time. request: for it.

        Raises RunError for a request of a spot in another frame.
        """
        angles = read_angles(self._order, self._port, state)
        spot = request.position if request is not None else None
        if request is not None and spot is not None and request.frame != self._frame:
            raise RunError(
                f"the position to look at has the frame {request.frame!r}; it must be "
                f"{self._frame!r}"
            )
        detections, hidden = self._detector.look(view, self._mount.pose(angles), spot)
        return Detections(
            frame=self._frame,
            types=[item.type for item in detections],
            position=[item.position for item in detections],
            orientation=[item.orientation for item in detections],
            confidence=[item.confidence for item in detections],
            hidden=hidden,
        )


class Perception(Participant):
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
        self._settings = PerceptionSettings(config)
        self._last_image_t = 0.0
        self._warned = False
        self._is_periodic = True
        # Joints and requests from the time on when the camera took what it puts out now.
        self._since: deque[tuple[JointState | None, CameraTrigger | None]] = deque(maxlen=1)

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Read the items from the description of the poses.

        Raises WiringError for poses without items, and for joints that are not sensed.
        """
        settings, params = self._settings, self._settings.params
        described = inputs[settings.poses]
        try:
            catalog = read_catalog(settings.poses, described)
            if (camera := settings.camera) is not None:
                if name := params.landmark:
                    radius = params.landmark_radius
                    catalog = with_landmarks(catalog, settings.poses, described, name, radius)
                late = inputs[camera.images[0]].details.get("latency")
                steps = parse_duration(late[0]) // self.config.step_ns if late else 0
                self._since = deque(maxlen=1 + steps // self.config.every)
                self._is_periodic = any(
                    inputs[port].details.get("period") for port in camera.images
                )
                self._camera = CameraSource(camera, catalog, inputs[camera.joint_state])
            else:
                self._truth = Truth(
                    settings.poses, described.names, catalog, params.frame, params.prefix
                )
        except WiringError as exc:
            lines = [f"{self.config.name}: {line}" for line in str(exc).splitlines()]
            raise WiringError("\n".join(lines)) from exc

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return new detections when they are due."""
        settings = self._settings
        try:
            detections = (
                self._from_truth(step)
                if settings.camera is None
                else self._from_images(step, settings.camera)
            )
        except RunError as exc:
            raise RunError(f"{self.config.name}: step {step.index}: {exc}") from exc
        return {} if detections is None else {settings.detections: detections}

    def _from_truth(self, step: Step) -> Detections | None:
        poses = step.get(self._settings.poses, Poses)
        due = (step.index // self.config.every) % self._settings.every == 0
        return self._truth.detections(poses) if due and poses is not None else None

    def _from_images(self, step: Step, source: CameraSettings) -> Detections | None:
        port = source.request
        request = step.get(port, CameraTrigger) if port and step.is_new(port) else None
        self._since.append((step.get(source.joint_state, JointState), request))
        if not all(step.is_new(port) for port in source.images):
            self._warn_if_late(step, source)
            return None
        self._last_image_t, self._warned = step.t, False
        images = {port: step.read(port, Image) for port in source.images}
        state, request = self._since[0]
        if state is None:
            state = step.read(source.joint_state, JointState)
        return self._camera.detections(make_view(images), state, request)

    def _warn_if_late(self, step: Step, source: CameraSettings) -> None:
        if (
            not self._is_periodic
            or self._warned
            or step.t - self._last_image_t < source.params.timeout
        ):
            return
        self._warned = True
        _log.warning(
            "%s: step %d: no new images on %s for %g s; is the camera on?",
            self.config.name,
            step.index,
            " and ".join(source.images),
            source.params.timeout,
        )

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the result."""
        versions = {name: installed_version(name) for name in ("numpy", "pin")}
        if self._settings.camera is not None:
            # OpenCV comes in packages with different names.
            import cv2  # noqa: PLC0415  source truth works without it

            versions["opencv"] = cv2.__version__
        return versions
