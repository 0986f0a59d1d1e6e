"""A generic plant: PyBullet physics of worlds written in YAML.

Everything but the parameters is imported when it is first used, so that these can be checked
without PyBullet.
"""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from stepbus_plant.plant import SimulatedPlant

    from .participant import Plant
    from .world.file import World, load_world

_MODULES = {
    "Plant": "participant",
    "SimulatedPlant": "plant",
    "World": "world.file",
    "load_world": "world.file",
}

__all__ = ["Params", "Plant", "SimulatedPlant", "World", "load_world"]

__getattr__ = imported_later(__name__, _MODULES)
