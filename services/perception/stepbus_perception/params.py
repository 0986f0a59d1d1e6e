"""The parameters of perception."""

from __future__ import annotations

from typing import Annotated, Literal

from stepbus_participant import File, Names, Positive, Settings, Share, Text, needed_when


class Params(Settings):
    """Parameters of `stepbus_perception`; those of the other source are ignored."""

    source: Literal["camera", "truth"] = "camera"
    """Whether items are found in images, or the true poses of the plant are published."""
    frame: Text = "chassis"
    """Link that the detections are given in."""
    model: Annotated[File, needed_when(source="camera")]
    """URDF or xacro of the robot that carries the camera."""
    joints: Annotated[Names, needed_when(source="camera")]
    """Joints that move the camera."""
    camera: Annotated[Text, needed_when(source="camera")] = "camera"
    """Optical frame of the camera."""
    timeout: Annotated[Positive, needed_when(source="camera")] = 3.0
    """Simulation time without images after which a warning is logged [s]."""
    min_confidence: Annotated[Share, needed_when(source="camera")] = 0.2
    """Detections below it are dropped [-]."""
    period: Annotated[Positive, needed_when(source="truth")] = 0.1
    """From one Detections/1 to the next [s]."""
