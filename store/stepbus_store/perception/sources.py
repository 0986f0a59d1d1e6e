"""What a scenario says about a participant that perceives."""

import importlib.util
from dataclasses import dataclass

from stepbus_participant import Config, Ports, Problems, extra_hint

from .params import Params
from .robot import CameraMount

_IMAGE = "Image/1"


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """How to find items in images.

    images: the two input ports. joint_state: input port. mount: where the camera is.
    timeout: simulation time without images after which a warning is due [s]. min_confidence:
    finds below it are dropped. depth_noise: at 1 m [m]. landmark: type of landmarks; empty: there
    are none. landmark_radius: [m].
    """

    images: tuple[str, str]
    joint_state: str
    mount: CameraMount
    timeout: float
    min_confidence: float
    depth_noise: float
    landmark: str
    landmark_radius: float


@dataclass(frozen=True, kw_only=True)
class TruthSettings:
    """How often to publish all items: every this many steps of the participant."""

    every: int


@dataclass(frozen=True, kw_only=True)
class PerceptionSettings:
    """What a scenario says.

    prefix: what the plant puts before the robot's names. frame: link that the detections are given
    in, without it.
    """

    poses: str
    detections: str
    prefix: str
    frame: str
    source: CameraSettings | TruthSettings


def read_settings(config: Config) -> PerceptionSettings:
    """Return what the scenario's params and ports say; raises SettingsError."""
    ports = Ports(config)
    poses = ports.input_of("Poses/1")
    detections = ports.output_of("Detections/1")
    ports.outputs_are("Detections/1")
    is_camera = config.param("source", "camera") == "camera"
    images = _images(config, ports.problems) if is_camera else ("", "")
    joint_state = ports.input_of("JointState/1") if is_camera else ""
    params = config.read(Params, ports.problems)
    source: CameraSettings | TruthSettings
    if params.source == "camera":
        source = CameraSettings(
            images=images,
            joint_state=joint_state,
            mount=_mount(config, params),
            timeout=params.timeout,
            min_confidence=params.min_confidence,
            depth_noise=params.depth_noise,
            landmark=params.landmark,
            landmark_radius=params.landmark_radius,
        )
    else:
        period_ns = config.step_ns * config.every
        source = TruthSettings(every=max(1, round(params.period * 1e9 / period_ns)))
    return PerceptionSettings(
        poses=poses,
        detections=detections,
        prefix=params.prefix,
        frame=params.frame,
        source=source,
    )


def _images(config: Config, problems: Problems) -> tuple[str, str]:
    """Return the ports of the images, identified by their descriptions."""
    images = [name for name, port in config.inputs.items() if port.type == _IMAGE]
    if len(images) != 2:
        text = f"{len(images)} are of type {_IMAGE}; source camera needs colour and depth"
        problems.add(("inputs",), text)
        return ("", "")
    return (images[0], images[1])


def _mount(config: Config, params: Params) -> CameraMount:
    problems = config.problems().below(("params",))
    if importlib.util.find_spec("cv2") is None:
        text = f"camera needs cv2 (OpenCV), which is not installed{extra_hint('cv2')}"
        problems.add(("source",), text)
    mount = problems.attempt(
        ("model",), lambda: CameraMount(params.model, params.joints, params.camera, params.frame)
    )
    if mount is None or len(problems):
        raise problems.error()
    return mount
