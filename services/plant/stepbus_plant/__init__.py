"""A generic plant: PyBullet physics of worlds written in YAML."""

from .params import Params, read_params
from .participant import PlantParticipant
from .plant import Plant
from .world.file import World, load_world

__all__ = ["Params", "Plant", "PlantParticipant", "World", "load_world", "read_params"]
