"""The parameters of perception."""

from typing import TYPE_CHECKING, Annotated, Literal

from stepbus_participant import (
    ModelFile,
    Names,
    NonNegative,
    Positive,
    Settings,
    Share,
    Text,
    imported_later,
    needed_when,
)


class Params(Settings):
    """Parameters of `stepbus_store.perception`; those of the other source are ignored."""

    source: Literal["camera", "truth"] = "camera"
    """`camera`: detects items in images; `truth`: publishes the plant's true poses. Parameters of
    the other source may stay in the scenario."""
    prefix: str = ""
    """What the plant puts before this robot's names: `left/` where two bodies of one URDF share
    a world. All other parameters name joints and links without it."""
    frame: Text = "chassis"
    """Link that the detections are given in, with z up."""
    model: Annotated[ModelFile, needed_when(source="camera")]
    """URDF or `.xacro` of the robot."""
    joints: Annotated[Names, needed_when(source="camera")]
    """Joints that move the camera, in any order; all others are at 0."""
    camera: Annotated[Text, needed_when(source="camera")] = "camera"
    """Link that is the optical frame: z forward, x right, y down."""
    timeout: Annotated[Positive, needed_when(source="camera")] = 3.0
    """Simulation time without images before a warning in the log [s]."""
    min_confidence: Annotated[Share, needed_when(source="camera")] = 0.2
    """Detections below it are dropped."""
    depth_noise: Annotated[NonNegative, needed_when(source="camera")] = 0.0
    """Standard deviation of depth at 1 m, which grows with the square of the distance: filters take
    it out, and the noise of colours [m]. 0: no filter."""
    landmark: Annotated[str, needed_when(source="camera")] = ""
    """Type under which landmarks are published: round marks whose links have names that begin with
    it. Default: there are none."""
    landmark_radius: Annotated[Positive, needed_when(source="camera")] = 0.015
    """Of each landmark [m]."""
    period: Annotated[Positive, needed_when(source="truth")] = 0.1
    """Between two messages [s]."""


if TYPE_CHECKING:
    from stepbus_store.perception.perception import Perception

__all__ = ["Params", "Perception"]

__getattr__ = imported_later(__name__, {"Perception": "perception"})
