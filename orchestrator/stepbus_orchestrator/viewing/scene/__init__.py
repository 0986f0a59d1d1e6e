"""What a recording shows: frames, what they look like, and where messages place them."""

from .build import DescribedPort, Ports, build_scene, recorded_topics
from .meshes import GREY, Color, Mesh, Visual
from .pose import Pose
from .scene import GHOST, Chain, Frame, Latest, Messages, Motion, Scene

__all__ = [
    "GHOST",
    "GREY",
    "Chain",
    "Color",
    "DescribedPort",
    "Frame",
    "Latest",
    "Mesh",
    "Messages",
    "Motion",
    "Ports",
    "Pose",
    "Scene",
    "Visual",
    "build_scene",
    "recorded_topics",
]
