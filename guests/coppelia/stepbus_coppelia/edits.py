"""What a script changes of the world between two simulations: bodies, masses, another world."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from stepbus_coppelia.clients import ApiError
from stepbus_coppelia.scene import JOINT, Scene, SceneObject
from stepbus_plant.geometry import Pose
from stepbus_plant.physics import Physics

ONLY_STOPPED = "the simulation is running; make and change bodies before sim.startSimulation."


@dataclass(kw_only=True)
class Changes:
    """What a script has put somewhere, or lets a link hold.

    frames: body → where it is put. joints: joint → where it is put [rad]. held: body → link that
    holds it; empty: it is let go.
    """

    frames: dict[str, Pose] = field(default_factory=dict)
    joints: dict[str, float] = field(default_factory=dict)
    held: dict[str, str] = field(default_factory=dict)

    def fields(self) -> dict[str, Any]:
        """Return them as the fields of a `SceneChange`; empty: there are none."""
        if not (self.frames or self.joints or self.held):
            return {}
        return {
            "bodies": list(self.frames),
            "position": [frame[0] for frame in self.frames.values()],
            "orientation": [frame[1] for frame in self.frames.values()],
            "joints": list(self.joints),
            "joint_position": list(self.joints.values()),
            "held": list(self.held),
            "holders": list(self.held.values()),
        }


@dataclass
class Edits:
    """Changes of the plant's parameters, which the next simulation has.

    opened: returns the world with these. world: file of another world; empty: the scenario's.
    primitives, models, masses: as of `SceneParams`, as plain data. is_new: whether the scene does
    not show them yet.
    """

    opened: Callable[[Mapping[str, Any]], Physics]
    world: str = ""
    primitives: dict[str, dict[str, Any]] = field(default_factory=dict)
    models: dict[str, dict[str, Any]] = field(default_factory=dict)
    masses: dict[str, float] = field(default_factory=dict)
    is_new: bool = False

    def params(self) -> dict[str, Any]:
        """Return them as parameters of the plant."""
        rows = {"primitives": self.primitives, "models": self.models, "masses": self.masses}
        given: dict[str, Any] = {key: value for key, value in rows.items() if value}
        return given | ({"world": self.world} if self.world else {})

    def show(self, scene: Scene) -> None:
        """Let the scene show them."""
        if self.is_new:
            self.is_new = False
            before = scene.physics
            scene.build(self.opened(self.params()))
            before.close()

    def make_shape(self, scene: Scene, kind: str, size: list[float]) -> SceneObject:
        """Add a box, sphere or cylinder [m]."""
        stem = {"box": "Cuboid", "sphere": "Sphere", "cylinder": "Cylinder"}[kind]
        name = _free(stem, self.primitives)
        self.primitives[name] = {"kind": kind, "size": size, "mass": _DENSITY * _volume(kind, size)}
        self.is_new = True
        made = scene.add_shape(name)
        made.alias = stem
        return made

    def load_model(self, scene: Scene, urdf: str, name: str) -> SceneObject:
        """Add a body from a model file."""
        name = _free(name, {**self.models, **dict.fromkeys(scene.physics.bodies)})
        self.models[name] = {"urdf": urdf}
        self.is_new = True
        return scene.add_shape(name)

    def remove(self, scene: Scene, thing: SceneObject) -> None:
        """Remove what the script has made."""
        known = self.primitives if thing.name in self.primitives else self.models
        if known.pop(thing.name, None) is None and (thing.link is not None or thing.kind == JOINT):
            raise ApiError(f"{scene.path(thing)} is part of the world, and cannot be removed.")
        self.masses.pop(thing.name, None)
        self.is_new = self.is_new or thing.is_model
        scene.remove(thing)

    def shape_changed(self, thing: SceneObject, changes: Mapping[str, Any]) -> None:
        """Change the mass [kg], colour, or other keys of `Primitive` of a shape."""
        row = self.primitives.get(thing.name)
        if row is not None:
            row |= changes
        elif "mass" in changes:
            self.masses[thing.name] = changes["mass"]
        thing.values |= changes
        self.is_new = self.is_new or row is not None or "mass" in changes


_DENSITY = 500.0
"""Of a shape that a script has made, as in CoppeliaSim [kg/m³]."""


def _volume(kind: str, size: list[float]) -> float:
    return size[0] * size[1] * size[2] * {"box": 1.0, "sphere": 0.5236, "cylinder": 0.7854}[kind]


def _free(stem: str, taken: Mapping[str, Any]) -> str:
    names = [stem, *(f"{stem}{number}" for number in range(len(taken) + 1))]
    return next(name for name in names if name not in taken)
