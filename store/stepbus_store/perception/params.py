"""The parameters of perception."""

from typing import Annotated, Literal

from stepbus_participant import (
    ModelFile,
    Names,
    NonNegative,
    Positive,
    Settings,
    Share,
    Text,
    needed_when,
)


class Params(Settings):
    """Parameters of `stepbus_store.perception`; those of the other source are ignored."""

    source: Literal["camera", "truth"] = "camera"
    """`camera`: detect items in images. `truth`: publish the plant's true poses. Parameters of
    the other source are ignored."""
    prefix: str = ""
    """Prefix of this robot's names in the plant, such as `left/` if two bodies from one URDF
    share a world. All other parameters name joints and links without it."""
    frame: Text = "chassis"
    """Reference link of the detections, with z up."""
    model: Annotated[ModelFile, needed_when(source="camera")]
    """URDF or `.xacro` of the robot."""
    joints: Annotated[Names, needed_when(source="camera")]
    """Joints that move the camera, in any order; all others are at 0."""
    camera: Annotated[Text, needed_when(source="camera")] = "camera"
    """Link that is the optical frame: z forward, x right, y down."""
    timeout: Annotated[Positive, needed_when(source="camera")] = 3.0
    """Log a warning after this simulation time without images [s]."""
    min_confidence: Annotated[Share, needed_when(source="camera")] = 0.2
    """Confidence below which detections are dropped."""
    depth_noise: Annotated[NonNegative, needed_when(source="camera")] = 0.0
    """Standard deviation of depth at 1 m [m]; grows with distance squared. Sets the strength of
    the depth and colour filter; 0: no filter."""
    landmark: Annotated[str, needed_when(source="camera")] = ""
    """Type of the landmarks in the detections: round marks whose link names begin with this text.
    Default: no landmarks."""
    landmark_radius: Annotated[Positive, needed_when(source="camera")] = 0.015
    """Radius of each landmark [m]."""
    period: Annotated[Positive, needed_when(source="truth")] = 0.1
    """Period of the detections [s]."""
