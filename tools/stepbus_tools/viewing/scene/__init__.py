"""What a recording shows: frames, what they look like, and where messages place them."""

from stepbus_tools.viewing.scene.pose import Pose, about

from .bodies import Body, Latest, Messages, all_positions, positions_in
from .build import Ports, build_scene
from .meshes import Color, Mesh, Visual
from .scene import GHOST, Chain, Frame, Scene, bounds

__all__ = [
    "GHOST",
    "Body",
    "Chain",
    "Color",
    "Frame",
    "Latest",
    "Mesh",
    "Messages",
    "Ports",
    "Pose",
    "Scene",
    "Visual",
    "about",
    "all_positions",
    "bounds",
    "build_scene",
    "positions_in",
]
