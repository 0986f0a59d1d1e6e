"""The plant: a world that can be sensed, commanded and advanced, independent of the bus."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from stepbus_participant import Problems, suggest
from stepbus_plant.calls import JointCalls
from stepbus_plant.camera import Cameras, Lens
from stepbus_plant.checkpoint import can_save, pack, unpack
from stepbus_plant.commander import Commander
from stepbus_plant.device_registry import Devices, planogram
from stepbus_plant.drives import locate_joints, make_drives
from stepbus_plant.engine import Physics
from stepbus_plant.errors import PhysicsError
from stepbus_plant.gripper import Gripper
from stepbus_plant.joint import Joint, describe_joints
from stepbus_plant.kinematic import NOTICE, Kinematics
from stepbus_plant.params import Params
from stepbus_plant.poses import PoseSensor
from stepbus_plant.script import Script, check_script
from stepbus_plant.sensing import Sensors, Values, Warnings
from stepbus_plant.sensor_registry import WorldSensors
from stepbus_plant.world_file import World
from stepbus_schemas import Description, JointState, Point, Poses, WiringError


class SimulatedPlant:
    """A simulated world that advances in steps of a fixed length.

    `params.joints` selects the joints to sense; the others behave the same. Until its first
    command, a joint swings freely in mode torque and stands still in modes velocity and position.

    period_ns: length of a communication step [ns]. seed: of the sensor noise. warnings: about
    commands without effect. physics: the engine that holds the world. devices, cameras, sensors:
    those that the world declares. script: scripted changes of it. t_ns: simulation time [ns].
    Raises WiringError when the world or a parameter is invalid.
    """

    def __init__(self, world: World, params: Params, period_ns: int, seed: int) -> None:
        problems = Problems()
        substep_ns = problems.attempt(
            (), lambda: world.physics_ns(period_ns, params.physics_step_ns)
        )
        step_ns = substep_ns or period_ns
        self.world = world
        self.params = params
        self._bodies = tuple(world.bodies)
        self._substeps = range(period_ns // step_ns)
        self._step_ns = step_ns
        self._period_ns = period_ns
        self.t_ns = 0
        self._seed = seed
        physics = problems.attempt((), lambda: Physics(world, step_ns, params))
        if physics is None:
            raise problems.error()
        self.physics = physics
        try:
            self._equip(params, problems)
        except WiringError:
            self.close()
            raise
        self.names = [joint.name for joint in self._joints]
        self._sensors = Sensors(params, seed)
        self._drives = make_drives(self.physics.client, self.physics.joints, step_ns * 1e-9)
        self._owners: dict[str, str] = {}
        self._efforts: Values = []
        self.warnings = Warnings()
        self._kinematics: Kinematics | None = None
        if params.dynamics == "off":
            self._disable_dynamics()
        for note in self.physics.notes:
            subject, _, text = note.partition(": ")
            self.warnings.add(subject, text, text)
        self._plan_reading()

    def _disable_dynamics(self) -> None:
        try:
            self._kinematics = Kinematics(self.physics, self._drives, self.devices, self.script)
        except WiringError:
            self.close()
            raise
        self.warnings.add("the plant", "dynamics", NOTICE)

    def _equip(self, params: Params, problems: Problems) -> None:
        """Select the sensed joints, and set up devices, cameras and script.

        problems: so far. Raises WiringError that lists all mistakes.
        """
        world, physics, period_ns = self.world, self.physics, self._period_ns
        problems.attempt((), physics.prepare)
        joints = problems.attempt((), lambda: _select(params.joints, physics))
        devices = problems.attempt(
            (), lambda: Devices(world, physics, self._bodies, params, self._seed)
        )
        cameras = problems.attempt(
            (),
            lambda: Cameras(
                world,
                physics.client,
                self._bodies,
                period_ns,
                Lens(params.camera, self._seed),
                enabled=params.cameras,
            ),
        )
        sensors = problems.attempt(
            (),
            lambda: WorldSensors(world, physics.client, self._bodies, period_ns, self._seed),
        )
        names = list(world.cameras)
        problems.attempt((), lambda: check_script(params.script, physics, self._bodies, names))
        if joints is None or devices is None or cameras is None or sensors is None:
            raise problems.error()
        problems.refuse()
        self._joints, self.devices, self.cameras = joints, devices, cameras
        self.sensors = sensors
        self.script = Script(params.script, physics, self._bodies, cameras)

    def _plan_reading(self) -> None:
        """Prepare what every step reads: one call per body, and where its results go."""
        bodies = dict.fromkeys(joint.body for joint in self._joints)
        groups = [[joint for joint in self._joints if joint.body == body] for body in bodies]
        self._groups = [(group[0].body, [joint.index for joint in group]) for group in groups]
        read = [joint.name for group in groups for joint in group]
        self._order = None if read == self.names else [read.index(name) for name in self.names]
        by_name = locate_joints(self._drives)
        drives = [by_name[name] for name in self.names]
        self._unread = [(n, d, i) for n, (d, i) in enumerate(drives) if d.torques() is not None]
        self._targeted = drives if all(drive.targets() is not None for drive, _ in drives) else []

    def describe(self) -> Description:
        """Return the joints of a JointState, in order, and their limits.

        In a world with bases or grippers, the detail `device` names the one a joint belongs to.
        """
        description = describe_joints(self._joints)
        owners = self.devices.owners
        details = dict(description.details)
        if owners:
            details["device"] = [owners.get(name, "") for name in self.names]
        if self._kinematics is not None:
            details["dynamics"] = ["off"] * len(self.names)
        return msgspec.structs.replace(description, details=details)

    def commander(self, port: str, names: Sequence[str], period_ns: int | None = None) -> Commander:
        """Return a commander for commands whose vectors are in the order of `names`.

        period_ns: between two commands [ns]; None: one command per communication step.
        Raises WiringError for names that do not match this world's joints.
        """
        return Commander(
            port,
            names,
            physics=self.physics,
            drives=self._drives,
            period=len(self._substeps) if period_ns is None else period_ns // self._step_ns,
            owners=self._owners,
            warnings=self.warnings,
        )

    def sense(self) -> JointState:
        """Return the sensor readings; `target` only if every sensed joint has one.

        Raises PhysicsError when the simulation has diverged.
        """
        states = self._read()
        position: Values = [state[0] for state in states]
        velocity: Values = [state[1] for state in states]
        # After a restart from a checkpoint, the engine does not know the torques of the last step.
        effort: Values = self._efforts or [state[3] for state in states]
        if not math.isfinite(sum(position) + sum(velocity)):
            self._check_finite(position, velocity)
        for number, drive, index in self._unread:
            effort[number] = (drive.torques() or effort)[index]
        return self._sensors.sense(position, velocity, effort, self._targets())

    def _targets(self) -> Values | None:
        if not self._targeted:
            return None
        return [(drive.targets() or [])[index] for drive, index in self._targeted]

    def _read(self) -> Sequence[Any]:
        """Return the engine's state of each sensed joint."""
        if len(self._groups) == 1:
            states: Sequence[Any] = self.physics.read(*self._groups[0])
        else:
            states = [state for group in self._groups for state in self.physics.read(*group)]
        return states if self._order is None else [states[i] for i in self._order]

    def _check_finite(self, position: Values, velocity: Values) -> None:
        states = zip(self.names, position, velocity, strict=True)
        diverged = [name for name, q, v in states if not (math.isfinite(q) and math.isfinite(v))]
        if diverged:
            raise PhysicsError(
                f"the simulation has diverged (joints {', '.join(diverged)}); use a shorter "
                "physics_step or smaller gains"
            )

    def advance(self) -> None:
        """Run the script, then advance by one communication step.

        Raises PhysicsError when the physics engine fails.
        """
        self._efforts = []
        self.script.run(self.t_ns)
        grippers = self.devices.grippers
        for _ in self._substeps:
            for drive in self._drives:
                drive.before_substep()
            if self._kinematics is None:
                self._substep(grippers)
        if self._kinematics is not None:
            self._kinematics.advance(self._period_ns * 1e-9)
        for gripper in grippers:
            gripper.update()
        self.t_ns += self._period_ns

    def _substep(self, grippers: Sequence[Gripper]) -> None:
        self.script.before_substep()
        for gripper in grippers:
            gripper.before_substep()
        self.physics.step()
        for gripper in grippers:
            gripper.after_substep(self._step_ns * 1e-9)

    def pose_sensor(
        self,
        links: Sequence[str] | None,
        points: Mapping[str, tuple[str, Point]] = {},
    ) -> PoseSensor:
        """Return a sensor of the true poses of links; None: of all links and points.

        points: as of `PoseSensor`. Raises WiringError for unknown links.
        """
        return PoseSensor(self.physics.client, self._bodies, links, points)

    def describe_poses(self, sensor: PoseSensor) -> Description:
        """Return the links of a pose sensor with body, shapes and colour of each.

        Raises WiringError for shapes of a URDF that cannot be parsed.
        """
        return sensor.describe(self.world, self.physics.urdfs)

    def planogram(self, sensor: PoseSensor) -> Poses:
        """Return where the links of a pose sensor belong, see `devices.planogram`."""
        return planogram(sensor.names, sensor.sense(), self.world.items)

    def save(self) -> bytes | None:
        """Return all that the next step depends on, None where it cannot be had to the bit.

        See `checkpoint.py`.
        """
        if self.script.has_moved or not can_save(self.world, self.params, self.physics):
            return None
        return pack(
            t_ns=self.t_ns,
            physics=self.physics,
            efforts=[state[3] for state in self._read()],
            drives=self._drives,
            sensors=self._sensors,
            owners=self._owners,
            warnings=self.warnings,
        )

    def restore(self, state: bytes) -> None:
        """Take what `save` returned."""
        saved = unpack(state, self.physics, self._drives, self._sensors, self.warnings)
        self.t_ns, self._efforts = saved.t_ns, saved.efforts
        self._owners.clear()
        self._owners.update(saved.owners)

    def joint_calls(self) -> JointCalls:
        """Return the calls that query joints and teleport them."""
        return JointCalls(self.physics, self._drives)

    def close(self) -> None:
        """Disconnect from the physics engine."""
        self.physics.close()


def _select(names: Sequence[str] | None, physics: Physics) -> list[Joint]:
    """Return the joints to sense, in order; names None: all."""
    if names is None:
        return list(physics.joints)
    known = {joint.name: joint for joint in physics.joints}
    mistakes = [
        f"params.joints: {name!r} is fixed in its model"
        if name in physics.fixed
        else f"params.joints: {name!r} is unknown{suggest(name, known)}"
        for name in names
        if name not in known
    ]
    if mistakes:
        raise WiringError("\n".join(mistakes))
    return [known[name] for name in names]
