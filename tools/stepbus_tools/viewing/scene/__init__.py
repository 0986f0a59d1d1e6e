"""What a recording shows: frames, what they look like, and where messages place them."""

from stepbus_tools.viewing.scene.primitives import Pose, about

from .build import DescribedPort, Ports, build_scene, recorded_topics
from .meshes import GREY, Color, Mesh, Visual
from .model import Joint
from .motions import Modelled, all_positions, measured
from .scene import GHOST, Chain, Frame, Latest, Messages, Motion, Scene

__all__ = [
    "GHOST",
    "GREY",
    "Chain",
    "Color",
    "DescribedPort",
    "Frame",
    "Joint",
    "Latest",
    "Mesh",
    "Messages",
    "Modelled",
    "Motion",
    "Ports",
    "Pose",
    "Scene",
    "Visual",
    "about",
    "all_positions",
    "build_scene",
    "measured",
    "recorded_topics",
]
