"""A plant whose bodies and joints a script may put somewhere, and that says where they are."""

import atexit
import dataclasses
import shutil
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from types import SimpleNamespace
from typing import Any

import msgspec

from stepbus_coppelia.messages import SceneChange
from stepbus_coppelia.plant import BODIES, CHANGES, Primitive, SceneParams
from stepbus_participant import CallError, Config, InvalidInput, Problems, Step, scratch_folder
from stepbus_plant import Plant, World
from stepbus_plant.engine import BASE, Link
from stepbus_plant.geometry import Pose
from stepbus_plant.world import Body, Friction
from stepbus_schemas import Description, Message


class ScenePlant(Plant):
    """A plant with an input `changes` (SceneChange/1) and an output `bodies` (BodyStates/1).

    Raises as `Plant`; InvalidInput for a change that names what is not there.
    """

    settings = SceneParams

    def __init__(self, config: Config) -> None:
        inputs = {port: row for port, row in config.inputs.items() if port != CHANGES}
        outputs = {port: row for port, row in config.outputs.items() if port != BODIES}
        super().__init__(dataclasses.replace(config, inputs=inputs, outputs=outputs))
        physics = self.plant.physics
        self._engine = physics.engine
        self._names = [n for n, body in physics.world.bodies.items() if not body.fixed_base]
        self._number = {name: number for number, name in enumerate(physics.bodies)}
        self._links = {**{n: (number, BASE) for n, number in self._number.items()}, **physics.links}
        self._held: dict[str, tuple[Link, Pose]] = {}
        self._has_changes = CHANGES in config.inputs
        self._has_bodies = BODIES in config.outputs and bool(self._names)
        # Of the types of the run, which our class has declared.
        self._state: Any = config.types["BodyStates/1"] if self._has_bodies else None
        # After the motors of each substep: what is held goes along.
        self.plant.devices.felt.append(self)

    def load(self, params: SceneParams, problems: Problems) -> World:
        """Return the world, with what the script has added to it before the simulation."""
        return scene_world(super().load(params, problems), params)

    def describe(self) -> Mapping[str, Description]:
        """Return the names of the bodies too."""
        own = {BODIES: Description(names=self._names)} if self._has_bodies else {}
        return {**super().describe(), **own}

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Map joint commands by joint name; raises as `Plant`."""
        super().start({port: row for port, row in inputs.items() if port != CHANGES})

    def output(self, step: Step) -> Mapping[str, Message]:
        """Return where all bodies are, beside the readings of the sensors."""
        messages = super().output(step)
        if not self._has_bodies:
            return messages
        motions = [self._engine.motion((self._number[name], BASE)) for name in self._names]
        state = self._state(
            position=[motion.frame[0] for motion in motions],
            orientation=[motion.frame[1] for motion in motions],
            velocity=[motion.velocity for motion in motions],
            spin=[motion.spin for motion in motions],
        )
        return {**messages, BODIES: state}

    def update(self, step: Step) -> Mapping[str, Message] | None:
        """Make the changes, then advance."""
        if self._has_changes and step.is_new(CHANGES):
            self._change(step.read(CHANGES))
        return super().update(step)

    def _change(self, change: SceneChange) -> None:
        engine = self._engine
        try:
            rows = zip(change.bodies, change.position, change.orientation, strict=True)
            for name, position, turn in rows:
                engine.put(self._number[name], (position, turn))
            for name, value in zip(change.joints, change.joint_position, strict=True):
                self.plant.calls.teleport(name, value)
            for name, holder in zip(change.held, change.holders, strict=True):
                self._held.pop(name, None)
                if holder:
                    frame = engine.frame(self._links[holder])
                    body = engine.frame((self._number[name], BASE))
                    relative = engine.geometry.compose(engine.geometry.inverse(frame), body)
                    self._held[name] = self._links[holder], relative
        except (KeyError, ValueError, CallError) as exc:
            raise InvalidInput(CHANGES, str(exc)) from exc
        if change.bodies or change.held:
            for number in self._number.values():
                engine.wake(number)

    def after_substep(self, _seconds: float) -> None:
        """Keep what is held where its link takes it."""
        for name, (holder, pose) in self._held.items():
            frame = self._engine.geometry.compose(self._engine.frame(holder), pose)
            self._engine.put(self._number[name], frame)

    def save(self) -> bytes | None:
        """Return the state of the plant, and what is held."""
        state = super().save()
        return None if state is None else msgspec.msgpack.encode((state, self._held))

    def restore(self, state: bytes) -> None:
        """Take a state from `save`."""
        kind = tuple[bytes, dict[str, tuple[Link, Pose]]]
        own, self._held = msgspec.msgpack.decode(state, type=kind)
        super().restore(own)


def scene_world(world: World, params: SceneParams) -> World:
    """Return a world with the primitives, models and masses of a script."""
    if not (params.primitives or params.models or params.masses):
        return world
    bodies, items = {**world.bodies, **params.models}, dict[str, Any](world.items)
    folder = _folder() if params.primitives else Path()
    for name, shape in params.primitives.items():
        urdf = folder / f"{name}.urdf"
        urdf.write_text("".join(_urdf(name, shape)), encoding="utf-8")
        bodies[name] = Body(urdf=urdf, position=shape.position, fixed_base=shape.static)
    for name, mass in params.masses.items():
        body, friction = bodies[name], bodies[name].friction or Friction()
        # As an `Item` of one link; it belongs where it is.
        at, yaw = body.position, body.orientation_rpy[2]
        own = {"name": name, "type": "", "urdf": body.urdf, "mass": mass}
        where = {"position": at, "yaw": yaw, "slot": at, "slot_yaw": yaw}
        lateral = 0.5 if friction.lateral is None else friction.lateral
        rubs = {"friction": lateral, "spinning_friction": friction.spinning or 0.0}
        items[name] = SimpleNamespace(**own, **where, **rubs)
    return msgspec.structs.replace(world, bodies=bodies, items=items)


@cache
def _folder() -> Path:
    """Return a folder for models, which ends with the run, or with this process."""
    folder = mkdtemp(prefix="stepbus-shapes-", dir=scratch_folder())
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _urdf(name: str, shape: Primitive) -> Iterator[str]:
    """Yield the text of a model of one link."""
    x, y, z = shape.size
    # What shows it, and the moments of a solid of even density, over its mass.
    box = (y * y + z * z) / 12, (x * x + z * z) / 12, (x * x + y * y) / 12
    across = x * x / 16 + z * z / 12
    rod = f'<cylinder radius="{x / 2}" length="{z}"/>'
    form, moments = {
        "box": (f'<box size="{x} {y} {z}"/>', box),
        "sphere": (f'<sphere radius="{x / 2}"/>', (x * x / 10,) * 3),
        "cylinder": (rod, (across, across, x * x / 8)),
    }[shape.kind]
    mass, (xx, yy, zz) = shape.mass, (moment * shape.mass for moment in moments)
    red, green, blue = shape.colour
    yield f'<robot name="{name}"><link name="{name}"><inertial><mass value="{mass}"/>'
    yield f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>'
    yield f'<visual><geometry>{form}</geometry><material name="own"><color rgba="'
    yield f'{red} {green} {blue} 1"/></material></visual>'
    if shape.respondable:
        yield f"<collision><geometry>{form}</geometry></collision>"
    yield "</link></robot>\n"
