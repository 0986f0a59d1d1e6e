"""A plant whose bodies and joints a script may put somewhere, and that says where they are."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import msgspec

from stepbus_coppelia.messages import SceneChange
from stepbus_coppelia.plant import BODIES, CHANGES, SceneParams
from stepbus_coppelia.world import scene_world
from stepbus_participant import CallError, Config, InvalidInput, Problems, Step
from stepbus_plant import Plant, World
from stepbus_plant.engine import BASE, Link
from stepbus_plant.geometry import Pose
from stepbus_schemas import Description, Message


class ScenePlant(Plant):
    """A plant with an input `changes` (SceneChange/1) and an output `bodies` (BodyStates/1).

    Raises as `Plant`; InvalidInput for a change that names what is not there.
    """

    settings = SceneParams

    def __init__(self, config: Config) -> None:
        inputs = {name: row for name, row in config.inputs.items() if name != CHANGES}
        outputs = {name: row for name, row in config.outputs.items() if name != BODIES}
        super().__init__(dataclasses.replace(config, inputs=inputs, outputs=outputs))
        physics = self.plant.physics
        self._engine = physics.engine
        rows = physics.world.bodies.items()
        self._names = [name for name, body in rows if not body.fixed_base]
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
            for name, position, turn in zip(
                change.bodies, change.position, change.orientation, strict=True
            ):
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
        own, self._held = msgspec.msgpack.decode(
            state, type=tuple[bytes, dict[str, tuple[Link, Pose]]]
        )
        super().restore(own)
