"""A generic plant: PyBullet physics of worlds written in YAML.

Everything but the parameters is imported when it is first used, so that these can be checked
without PyBullet.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .params import Params

if TYPE_CHECKING:
    from .participant import PlantParticipant
    from .plant import Plant
    from .world.file import World, load_world

_MODULES = {
    "Plant": "plant",
    "PlantParticipant": "participant",
    "World": "world.file",
    "load_world": "world.file",
}

__all__ = ["Params", "Plant", "PlantParticipant", "World", "load_world"]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f".{_MODULES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
