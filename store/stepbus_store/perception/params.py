"""The parameters of perception."""

from collections.abc import Iterator
from typing import Literal

from stepbus_participant import ModelFile, Names, NonNegative, Positive, Settings, Share, Text
from stepbus_participant.parameters import Keys


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
    model: ModelFile | None = None
    """URDF or `.xacro` of the robot. Required with `source: camera`."""
    joints: Names | None = None
    """Joints that move the camera, in any order; all others are at 0. Required with
    `source: camera`."""
    camera: Text = "camera"
    """Link that is the optical frame: z forward, x right, y down."""
    min_confidence: Share = 0.2
    """Confidence below which detections are dropped."""
    depth_noise: NonNegative = 0.0
    """Standard deviation of depth at 1 m [m]; grows with distance squared. Sets the strength of
    the depth and colour filter; 0: no filter."""
    landmark: str = ""
    """Type of the landmarks in the detections: round marks whose link names begin with this text.
    Default: no landmarks."""
    landmark_radius: Positive = 0.015
    """Radius of each landmark [m]."""
    period: Positive = 0.1
    """Period of the detections with `source: truth` [s]."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield the parameters that a camera lacks."""
        for key, value in (("model", self.model), ("joints", self.joints)):
            if self.source == "camera" and value is None:
                yield (key,), "is missing; source camera needs it"
