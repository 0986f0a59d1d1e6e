"""A generic plant: physics, in PyBullet or MuJoCo, of worlds written in YAML.

Everything but the parameters is imported when it is first used, so that these can be checked
without an engine.
"""

from typing import TYPE_CHECKING

from stepbus_participant import imported_later

from .params import Params

if TYPE_CHECKING:
    from stepbus_plant.plant import SimulatedPlant
    from stepbus_plant.world_file import World, load_world

    from .participant import Plant

_MODULES = {
    "Plant": "participant",
    "SimulatedPlant": "plant",
    "World": "world_file",
    "load_world": "world_file",
}

__all__ = ["Params", "Plant", "SimulatedPlant", "World", "load_world"]

__getattr__ = imported_later(__name__, _MODULES)
