"""The plant: a world that can be sensed, commanded and advanced, independent of the bus."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import msgspec

from stepbus_participant import Problems, format_duration
from stepbus_plant.calls import Calls
from stepbus_plant.commander import Commander, StopSwitch
from stepbus_plant.devices import Devices, mistakes
from stepbus_plant.drives import Motors
from stepbus_plant.joint import Joint
from stepbus_plant.kinematic import NOTICE, Kinematics
from stepbus_plant.memory import Remembers
from stepbus_plant.params import Params
from stepbus_plant.physics import Physics
from stepbus_plant.push import PUSH, PushDriver, Pushes
from stepbus_plant.script import Script, check_script
from stepbus_plant.sensing import JointSensor
from stepbus_plant.world_file import World
from stepbus_schemas import JointState, WiringError


class SimulatedPlant(Remembers):
    """A simulated world that advances in steps of a fixed length.

    `params.joints` selects the joints to sense; the others behave the same. Until its first
    command, a joint swings freely in mode torque and stands still in modes velocity and position.

    period_ns: length of a communication step [ns]. seed: of the sensor noise. problems: what is
    wrong so far with the owner of these params; default: nothing. physics: the engine with the
    world. joints: the sensor of the joints; names: theirs. motors: what drives the
    joints. warnings: about commands without effect. devices: those that the world declares. stop:
    the emergency stop. script: scripted changes. calls: what may be asked between two steps. t_ns:
    simulation time [ns].
    Raises SettingsError when the world or a parameter is invalid, with all that is wrong.
    """

    remembers, parts = ("t_ns",), ("joints", "devices", "stop", "script", "motors")

    def __init__(
        self,
        world: World,
        params: Params,
        period_ns: int,
        seed: int,
        problems: Problems | None = None,
    ) -> None:
        problems = Problems() if problems is None else problems
        wrong = problems.below(("params",))
        step_ns = _substep_ns(world, params, period_ns, wrong)
        self.world = world
        self.params = params
        self._substeps = range(period_ns // step_ns)
        self._step_ns = step_ns
        self._period_ns = period_ns
        self.t_ns = 0
        physics = problems.attempt((), lambda: Physics(world, step_ns, params, wrong))
        if physics is None:
            raise problems.error()
        self.physics = physics
        try:
            joints = _checked(physics, params, period_ns, wrong)
        except WiringError:
            physics.close()
            raise
        self.names = [joint.name for joint in joints]
        self.devices = Devices(physics, params, period_ns, seed)
        self.stop = StopSwitch()
        pushes = Pushes(physics, step_ns)
        self.script = Script(params.script, physics, self.devices.cameras, self.stop, pushes)
        self.motors = Motors(physics, step_ns, period_ns)
        self.warnings = self.motors.warnings
        self.calls = Calls(self.motors, self.script, lambda: self.t_ns)
        owners, details = self.devices.owners(), {}
        if owners:
            details["device"] = [owners.get(name, "") for name in self.names]
        self._kinematics: Kinematics | None = None
        if params.dynamics == "off":
            self._kinematics = Kinematics(self.motors, self.devices, self.script)
            self.warnings.add("the plant", "dynamics", NOTICE)
            details["dynamics"] = ["off"] * len(joints)
        self.joints = JointSensor(joints, self.motors, params, seed, details)

    def commander(self, port: str, names: Sequence[str], period_ns: int | None = None) -> Commander:
        """Return what executes commands of joints; arguments and errors are those of its class."""
        return Commander(port, names, self.motors, period_ns)

    def driver(self, port: str, port_type: str) -> Commander:
        """Return what executes an input that does not command joints.

        Raises WiringError where the world has no device for it, or no link that it can push.
        """
        if port_type == PUSH:
            row = self.params.pushes.get(port)
            return PushDriver(port, row, self.script.pushes, self.motors)
        return self.devices.driver(port, port_type, self.motors)

    def sense(self) -> JointState:
        """Return the readings of the joints; raises PhysicsError when these have diverged."""
        return self.joints.sense(self.t_ns)

    def advance(self) -> None:
        """Run the script, then advance by one communication step.

        Raises PhysicsError when the physics engine fails.
        """
        self.joints.efforts = []
        script, grippers, kinematics = self.script, self.devices.grippers, self._kinematics
        script.run(self.t_ns)
        before: list[Any] = self.motors.drives
        after: list[Any] = self.devices.felt
        if kinematics is not None:
            moving = script.moving.values()
            before, after = [*before, *moving], [*moving]
        elif script.moving or script.jammed or script.pushes or grippers:
            moving, devices = script.moving.values(), grippers.values()
            jams = [script] if script.jammed else []
            pushes = [script.pushes] if script.pushes else []
            before = [*before, *moving, *jams, *devices, *pushes]
            after = [*devices, *moving, *after]
        for _ in self._substeps:
            for item in before:
                item.before_substep()
            if kinematics is None:
                self.physics.engine.step()
            for item in after:
                item.after_substep(self._step_ns * 1e-9)
        if kinematics is not None:
            kinematics.advance(self._period_ns * 1e-9)
        for gripper in grippers.values():
            gripper.update()
        self.t_ns += self._period_ns

    def unsaved(self) -> str:
        """Return why the state cannot be saved to the last bit; empty: it can."""
        if self._kinematics is not None:
            return "`dynamics: off` has no state of an engine"
        if self.script.moving:
            return f"{next(iter(self.script.moving))} is being moved"
        if why := self.physics.engine.unsaved(self.physics.bodies):
            return why
        busy = [name for name, camera in self.devices.cameras.items() if camera.is_busy]
        return f"an image of camera {busy[0]} is on its way" if busy else ""

    def save(self) -> bytes:
        """Return all that the next step depends on, where nothing is `unsaved`."""
        parts = (self.physics.engine.save(), self.joints.applied(), super().save())
        return msgspec.msgpack.encode(parts)

    def restore(self, state: bytes) -> None:
        """Take a state from `save`."""
        engine, self.joints.efforts, saved = msgspec.msgpack.decode(state)
        self.physics.engine.restore(engine)
        super().restore(saved)

    def close(self) -> None:
        """Disconnect from the physics engine."""
        self.physics.close()


def _substep_ns(world: World, params: Params, period_ns: int, problems: Problems) -> int:
    """Return the length of a physics substep [ns]; problems: of the params."""
    step = f"the plant's step of {format_duration(period_ns)}"
    step_ns = params.physics_step_ns or world.physics_step_ns
    if step_ns is None:
        step_ns, rest = divmod(period_ns, world.substeps or 1)
        key = "substeps"
        text = f"{world.substeps} substeps do not divide {step} into whole nanoseconds"
    else:
        rest = period_ns % step_ns
        key, text = "physics_step", f"{format_duration(step_ns)} does not divide {step}"
    if step_ns and not rest:
        return step_ns
    if params.physics_step_ns is None:
        problems.attempt((), partial(world.source.refuse, [((key,), text)]))
    else:
        problems.add((key,), text)
    return period_ns


def _checked(physics: Physics, params: Params, period_ns: int, problems: Problems) -> list[Joint]:
    """Return the joints to sense; problems: of the params so far.

    Raises SettingsError with all that is wrong with params and world.
    """
    names = list(physics.joints) if params.joints is None else params.joints
    for name in names:
        if text := physics.lacks_joint(name):
            problems.add(("joints",), f"{name!r} {text}")
    torque = [name for name, j in physics.joints.items() if j.effective_mode == "torque"]
    if params.dynamics == "off" and torque:
        text = (
            f"off needs joints of mode position or velocity; {', '.join(torque[:3])} has mode "
            "torque"
        )
        problems.add(("dynamics",), text)
    check_script(params.script, physics, problems)
    in_world = [*physics.mistakes, *mistakes(physics, period_ns)]
    problems.attempt((), partial(physics.world.source.refuse, in_world))
    problems.refuse()
    return [physics.joints[name] for name in names]
