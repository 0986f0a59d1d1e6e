"""The plant: a world that is sensed, commanded and advanced; it knows nothing of the bus."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from stepbus.settings import nearest
from stepbus_schemas import Description, JointState, WiringError

from .actuation import Commander, Driven, PositionMotor, make_drive
from .params import Params
from .physics import Joint, Physics
from .sensing import Sensors, Values
from .world import World


class Plant:
    """A simulated world in steps of a fixed length.

    period_ns: length of a communication step [ns]. seed: of the sensors' noise.
    Raises WiringError when the world or a parameter cannot work.
    """

    def __init__(self, world: World, params: Params, period_ns: int, seed: int) -> None:
        step_ns = world.physics_ns(period_ns)
        self._substeps = period_ns // step_ns
        self._physics = Physics(world, step_ns, params.actuation)
        try:
            self._joints = self._chosen(params.joints)
            self._driven = self._make_drives()
            self._sensors = Sensors(params, self.names, seed)
        except BaseException:
            self.close()
            raise
        self._groups = self._reading_order()
        self._motors = [d for d in self._driven if isinstance(d.drive, PositionMotor)]
        self._advanced = False

    @property
    def names(self) -> list[str]:
        """Return the names of the sensed joints, in the order of every vector."""
        return [joint.name for joint in self._joints]

    def _chosen(self, names: Sequence[str] | None) -> list[Joint]:
        joints = {joint.name: joint for joint in self._physics.joints}
        for name in names or []:
            if name not in joints:
                raise WiringError(f"params.joints: joint {name!r}: {nearest(name, joints)}")
        return [joints[name] for name in names] if names else list(joints.values())

    def _make_drives(self) -> list[Driven]:
        """Return one drive per body, mode and actuation, so that each is one call a step."""

        def key(joint: Joint) -> tuple[int, str, str]:
            return (joint.body, joint.mode, joint.actuation)

        rows = sorted(self._joints, key=key)
        groups = [list(joints) for _, joints in groupby(rows, key)]
        return [Driven(make_drive(self._physics, g), [j.name for j in g]) for g in groups]

    def _reading_order(self) -> list[tuple[int, list[int], list[int]]]:
        """Return (body, joint indices, their places in the vectors), one row per body."""
        bodies = dict.fromkeys(joint.body for joint in self._joints)
        return [
            (
                body,
                [joint.index for joint in self._joints if joint.body == body],
                [place for place, joint in enumerate(self._joints) if joint.body == body],
            )
            for body in bodies
        ]

    def describe(self) -> Description:
        """Return who the vectors of a JointState belong to, and their limits."""
        joints = self._joints
        return Description(
            names=self.names,
            limits={
                "lower": [joint.lower for joint in joints],
                "upper": [joint.upper for joint in joints],
                "velocity": [joint.max_velocity for joint in joints],
                "effort": [joint.effort for joint in joints],
            },
            details={
                "type": [joint.kind for joint in joints],
                "mode": [joint.mode for joint in joints],
            },
        )

    def commander(self, port: str, names: Sequence[str]) -> Commander:
        """Return what carries out commands whose vectors are in the order of `names`.

        Raises CommandError when they do not fit this world's joints.
        """
        return Commander(port, names, self._physics, self._driven)

    def sense(self) -> JointState:
        """Return what the sensors show now.

        Raises PhysicsError when the simulation has diverged.
        """
        count = len(self._joints)
        position, velocity, effort = [0.0] * count, [0.0] * count, [0.0] * count
        for body, indices, places in self._groups:
            states = self._physics.read(body, indices)
            for place, state in zip(places, states, strict=True):
                position[place], velocity[place] = state[0], state[1]
                effort[place] = state[3]
        self._fill_efforts(effort)
        true: dict[str, Values] = {"position": position, "velocity": velocity, "effort": effort}
        return self._sensors.sense(true, self._targets())

    def _fill_efforts(self, effort: list[float]) -> None:
        """Put in the torques that the physics engine applies and does not report."""
        for driven in self._driven:
            applied = driven.drive.efforts()
            if applied is not None and self._advanced:
                for name, value in zip(driven.names, applied, strict=True):
                    effort[self._places[name]] = value

    @property
    def _places(self) -> dict[str, int]:
        return {name: place for place, name in enumerate(self.names)}

    def _targets(self) -> list[float] | None:
        """Return the newest position targets, where every joint has one."""
        found = {
            name: target
            for driven in self._motors
            if isinstance(driven.drive, PositionMotor)
            for name, target in zip(driven.names, driven.drive.targets, strict=True)
        }
        return [found[name] for name in self.names] if len(found) == len(self._joints) else None

    def advance(self) -> None:
        """Advance by one communication step.

        Raises PhysicsError when the physics engine fails.
        """
        for _ in range(self._substeps):
            for driven in self._driven:
                driven.drive.before_substep()
            self._physics.step()
        self._advanced = True

    def close(self) -> None:
        """Leave the physics engine."""
        self._physics.close()
