"""What a scenario says about a participant that perceives."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from typing import Literal

from stepbus_participant import Config
from stepbus_participant.settings import Settings
from stepbus_schemas import WiringError

from .robot import CameraMount

_IMAGE = "Image/1"


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """How to find items in images.

    images: the two input ports. joint_state: input port. mount: where the camera is.
    timeout: simulation time without images after which a warning is due [s]. min_confidence:
    finds below it are dropped.
    """

    images: tuple[str, str]
    joint_state: str
    mount: CameraMount
    timeout: float
    min_confidence: float


@dataclass(frozen=True, kw_only=True)
class TruthSettings:
    """How often to tell where all items are: every so many steps of the participant."""

    every: int


@dataclass(frozen=True, kw_only=True)
class PerceptionSettings:
    """What a scenario says; frame: link that the detections are given in."""

    poses: str
    detections: str
    frame: str
    source: CameraSettings | TruthSettings


_PARAMS = ("model", "joints", "camera", "timeout", "min_confidence", "period")


def read_settings(config: Config) -> PerceptionSettings:
    """Return what the scenario's params and ports say.

    source: `camera` or `truth`. frame: link (chassis). For the camera: model: URDF or xacro,
    joints: those that move the camera, camera: link (camera), timeout: simulation time without
    images until a warning [s] (3), min_confidence: 0 to 1 (0.2). For the truth: period: [s]
    (0.1). What belongs to the other source may stay in the scenario.
    Raises WiringError with all that is wrong.
    """
    settings = Settings(config)
    poses = settings.input_of("Poses/1")
    detections = settings.output_of("Detections/1")
    settings.outputs_are("Detections/1")
    source: Literal["camera", "truth"] | str = settings.choice(
        "source", ("camera", "truth"), "camera"
    )
    frame = _link(settings, "frame", "chassis")
    chosen = _camera(settings, config, frame) if source == "camera" else _truth(settings, config)
    for name in _PARAMS:
        settings.value(name, "unused")
    settings.check()
    if chosen is None:
        settings.refuse()
    return PerceptionSettings(poses=poses, detections=detections, frame=frame, source=chosen)


def _truth(settings: Settings, config: Config) -> TruthSettings:
    period = settings.number("period", 0.1, bound="positive")
    return TruthSettings(every=max(1, round(period * 1e9 / (config.step_ns * config.every))))


def _camera(settings: Settings, config: Config, frame: str) -> CameraSettings | None:
    images = [name for name, port in config.inputs.items() if port.type == _IMAGE]
    if len(images) != 2:
        problem = f"{len(images)} are of type {_IMAGE}; source camera needs colour and depth"
        settings.note_all([f"participants.{config.name}.inputs: {problem}"])
    joint_state = settings.input_of("JointState/1")
    timeout = settings.number("timeout", 3.0, bound="positive")
    least = settings.number("min_confidence", 0.2, bound="not negative")
    if least > 1:
        settings.note("min_confidence", f"is {least:g}, has to be 0 to 1")
    if importlib.util.find_spec("cv2") is None:
        settings.note(
            "source", "camera needs OpenCV, which is not installed; pip install 'stepbus[robots]'"
        )
    mount = _mount(settings, _link(settings, "camera", "camera"), frame)
    if mount is None or len(images) != 2:
        return None
    return CameraSettings(
        images=(images[0], images[1]),
        joint_state=joint_state,
        mount=mount,
        timeout=timeout,
        min_confidence=least,
    )


def _mount(settings: Settings, camera: str, frame: str) -> CameraMount | None:
    path, joints = settings.file("model"), settings.names("joints")
    if path is None or not joints:
        return None
    try:
        return CameraMount(path, joints, camera, frame)
    except WiringError as exc:
        for problem in str(exc).splitlines():
            settings.note("model", problem)
        return None


def _link(settings: Settings, param: str, default: str) -> str:
    value = settings.value(param, default)
    if not isinstance(value, str) or not value:
        settings.note(param, f"is {value!r}, not the name of a link")
        return default
    return value
