"""What a script changes of the scene: at once, or in the next simulation."""

import copy
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from stepbus_coppelia.clients import ApiError
from stepbus_coppelia.joints import Control, Group
from stepbus_coppelia.scene import JOINT, Scene, SceneObject
from stepbus_plant.geometry import Pose
from stepbus_plant.joint import Joint
from stepbus_plant.physics import Physics
from stepbus_schemas import JointCommand, WiringError

_DENSITY = 500.0
"""Of a shape that a script has made, as in CoppeliaSim [kg/m³]."""
_FORMS = {"box": ("Cuboid", 1.0), "sphere": ("Sphere", 0.5236), "cylinder": ("Cylinder", 0.7854)}
"""Alias of a shape, and its part of the box around it."""


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

    world: file of another world; empty: the scenario's. primitives, models, masses: as of
    `SceneParams`, as plain data. is_new: whether the scene does not show them yet.
    """

    world: str = ""
    primitives: dict[str, dict[str, Any]] = field(default_factory=dict)
    models: dict[str, dict[str, Any]] = field(default_factory=dict)
    masses: dict[str, float] = field(default_factory=dict)
    is_new: bool = False

    def params(self) -> dict[str, Any]:
        """Return them as parameters of the plant."""
        return {key: row for key, row in vars(self).items() if row and key != "is_new"}


class EditedScene(Scene):
    """The scene with what a script has changed of it.

    opened: returns the world with `Edits.params`. controls: how each joint is driven. initial:
    what was changed before a simulation, as each begins with it. changes: of this step.
    """

    def __init__(
        self,
        opened: Callable[[Mapping[str, Any]], Physics],
        aliases: Mapping[str, str],
        sensors: Mapping[str, Any],
    ) -> None:
        self._opened, self.edits, self.is_running = opened, Edits(), False
        self.initial, self.changes = Changes(), Changes()
        self._kept, self._groups = set[int](), dict[str, Group]()
        super().__init__(opened({}), aliases, sensors)
        self._restore()

    def connect(self, groups: dict[str, Group], joints: Sequence[str], bodies: list[str]) -> None:
        """Take what a run has: the joints of each command, and of the messages of the plant."""
        self._groups, self.body_names = groups, bodies
        self.order = [self.joint_index[name] for name in joints]

    def commands(self) -> dict[str, JointCommand]:
        """Return the commands of a step, by port: those that are new."""
        return {
            port: group.command(self.controls, self)
            for port, group in self._groups.items()
            if any(self.controls[name].is_new for name in group.names)
        }

    def begin(self) -> None:
        """Begin a simulation: it has all that was changed before."""
        self.settle()
        self.is_running, self._kept = True, set(self.objects)
        self.changes = copy.deepcopy(self.initial)
        for control in self.controls.values():
            control.is_new = True

    def end(self) -> None:
        """End it: all is as before, and what was made meanwhile is gone."""
        self.is_running = False
        for handle in self.objects.keys() - self._kept:
            self.remove(self.objects[handle])
        self.reset()
        self._restore()

    def settle(self) -> None:
        """Show what has changed since the scene was last asked."""
        if self.edits.is_new:
            self.edits.is_new, before = False, self.physics
            self.build(self._opened(self.edits.params()))
            before.close()
            self._restore()
        super().settle()

    def _restore(self) -> None:
        """Put everything where the script has put it before the simulation, undriven."""
        self.controls = {name: Control.of(j) for name, j in self.physics.joints.items()}
        for body, frame in self.initial.frames.items():
            if body in self.physics.bodies:
                self.engine.put(self.physics.bodies.index(body), frame)
        for name, value in self.initial.joints.items():
            self.move_joint(self.physics.joints[name], value)

    # --- what takes effect at once --------------------------------------------------------

    @property
    def _noted(self) -> Changes:
        """Return where a change is noted; one before the simulation counts in each."""
        return self.changes if self.is_running else self.initial

    def put(self, thing: SceneObject, pose: Pose) -> None:
        """Put an object somewhere in the world."""
        self.move(thing, pose)
        if thing.is_root:
            self._noted.frames[self.body(thing)] = pose

    def put_joint(self, joint: Joint, position: float) -> None:
        """Put a joint somewhere [rad]."""
        self.move_joint(joint, position)
        self._noted.joints[joint.name] = position

    def hold(self, thing: SceneObject, holder: SceneObject | None) -> None:
        """Let a body go along with what another object is on; None: let it go."""
        while holder is not None and holder.link is None:
            holder = self.objects.get(holder.parent)
        names = {link: name for name, link in self.physics.links.items()}
        link = None if holder is None else holder.link
        self._noted.held[self.body(thing)] = "" if link is None else names[link]

    # --- what the next simulation has -----------------------------------------------------

    def make_shape(self, kind: str, size: list[float], **more: Any) -> int:
        """Make a box, sphere or cylinder [m], with more keys of `Primitive`; return its handle."""
        if min(size) <= 0.0:
            raise ApiError(f"sizes must be above 0 m, not {min(size):g}.")
        (alias, part), known = _FORMS[kind], self.edits.primitives
        mass = _DENSITY * (size[0] * size[1] * size[2] * part)
        row = {"kind": kind, "size": size, "mass": mass, **more}
        made = self._make(alias, known, known, row)
        made.alias = alias
        return made.handle

    def load_model(self, urdf: str, name: str) -> int:
        """Add a body from a model file; return its handle."""
        known = self.edits.models
        made = self._make(name, {*known, *self.physics.bodies}, known, {"urdf": urdf})
        self._show(lambda: self.discard(made))
        return made.handle

    def load_world(self, world: str) -> None:
        """Take another world."""
        self._must_be_stopped()
        before = self.edits, self.initial
        self.edits, self.initial = Edits(world, is_new=True), Changes()

        def undo() -> None:
            self.edits, self.initial = before

        self._show(undo)

    def change(self, thing: SceneObject, key: str, value: Any) -> None:
        """Change a key of `Primitive` of a shape that was made, or the mass of a body [kg]."""
        row = self.edits.primitives.get(thing.name)
        if row is None and key != "mass":
            return
        if key not in ("mass", "colour"):
            self._must_be_stopped()
        if row is not None:
            row[key] = value
        elif self._is_one_link(thing):
            self.edits.masses[thing.name] = value
        else:
            raise ApiError(f"{self.path(thing)} is a robot, whose masses are in its model.")
        # While it runs, the scene shows the bodies of the plant, which has begun.
        self.edits.is_new = not self.is_running

    def discard(self, thing: SceneObject) -> None:
        """Remove what the script has made."""
        if thing.is_model:
            self._must_be_stopped()
        edits = self.edits
        known = edits.primitives if thing.name in edits.primitives else edits.models
        if known.pop(thing.name, None) is None and (thing.link is not None or thing.kind == JOINT):
            raise ApiError(f"{self.path(thing)} is part of the world, and cannot be removed.")
        edits.masses.pop(thing.name, None)
        edits.is_new = edits.is_new or thing.is_model
        self.remove(thing)

    def _make(
        self, stem: str, taken: Collection[str], rows: dict[str, Any], row: dict[str, Any]
    ) -> SceneObject:
        self._must_be_stopped()
        names = [stem, *(f"{stem}{number}" for number in range(len(taken) + 1))]
        name = next(name for name in names if name not in taken)
        rows[name], self.edits.is_new = row, True
        return self.add_shape(name)

    def _is_one_link(self, thing: SceneObject) -> bool:
        """Return whether an object is a body of one link with a mass, as an item of a world is."""
        if not thing.is_root or thing.link is None:
            return False
        robot = self.physics.robots[thing.link[0]]
        inertial = robot.links[robot.root].inertial
        return len(robot.links) == 1 and inertial is not None and inertial.mass > 0.0

    def _show(self, undo: Callable[[], object]) -> None:
        """Let the scene show a change at once, or undo it; raises ApiError, which says why not."""
        before = self.physics
        try:
            self.settle()
        except (ApiError, WiringError) as exc:
            undo()
            self.edits.is_new = False
            if self.physics is not before:
                self.build(before)
            raise ApiError(str(exc)) from exc

    def _must_be_stopped(self) -> None:
        if self.is_running:
            text = "make and change bodies before sim.startSimulation."
            raise ApiError(f"the simulation is running; {text}")
