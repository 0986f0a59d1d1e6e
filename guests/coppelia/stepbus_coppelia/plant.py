"""Parameters of a plant whose scene a script changes; the plant itself is imported when used."""

from typing import TYPE_CHECKING, Literal

from stepbus_participant import Finite, Positive, Settings, Vector3, imported_later
from stepbus_plant import Params as PlantParams
from stepbus_plant.world import Body

if TYPE_CHECKING:
    from .scene_plant import ScenePlant

__all__ = ["BODIES", "CHANGES", "Params", "Primitive", "SceneParams", "ScenePlant"]

CHANGES, BODIES = "changes", "bodies"
"""Ports of the plant."""


class Primitive(Settings):
    """A shape that a script has made."""

    kind: Literal["box", "sphere", "cylinder"]
    """Its shape."""
    size: tuple[Positive, Positive, Positive]
    """Along x, y and z [m]."""
    mass: Positive = 1.0
    """[kg]"""
    static: bool = True
    """Whether it stays where it is."""
    respondable: bool = False
    """Whether other bodies collide with it."""
    colour: tuple[Finite, Finite, Finite] = (0.75, 0.75, 0.75)
    """Red, green and blue, 0 to 1."""
    position: Vector3 = (0.0, 0.0, 0.0)
    """Position in the world [m]."""


class SceneParams(PlantParams):
    """Parameters of a plant whose scene a script has changed before the simulation."""

    primitives: dict[str, Primitive] = {}
    """Shapes that the script has made."""
    models: dict[str, Body] = {}
    """Bodies that the script has loaded."""
    masses: dict[str, Positive] = {}
    """Masses that the script has given to bodies of one link [kg]."""


Params = SceneParams
__getattr__ = imported_later("stepbus_coppelia", {"ScenePlant": "scene_plant"})
