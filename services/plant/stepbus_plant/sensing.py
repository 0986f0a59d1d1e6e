"""Joint states: true ones, as the engine has them, turned into sensor readings."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, cast

import numpy as np

from stepbus_plant.drives import DirectTorque, Motors, PositionMotor
from stepbus_plant.engine import PhysicsError
from stepbus_plant.joint import Joint, describe_joints
from stepbus_plant.memory import Remembers
from stepbus_plant.noise import Errors
from stepbus_plant.params import Params
from stepbus_schemas import JointState

Values = list[float]
"""One number per sensed joint."""


class JointSensor(Remembers):
    """Reads the states of joints.

    joints: sensed joints, in order. details: added to the description. seed: of the noise; each
    quantity has its own random stream, so that the noise on one does not change the noise on
    another. efforts: torques of the latest step [N·m] after a restart from a checkpoint, which the
    engine does not know then; else empty.
    """

    parts = ("_errors",)

    def __init__(
        self,
        joints: Sequence[Joint],
        motors: Motors,
        params: Params,
        seed: int,
        details: Mapping[str, list[str]],
    ) -> None:
        self.joints = list(joints)
        self.efforts: Values = []
        self._engine = motors.physics.engine
        self._errors = {
            quantity: Errors([seed, number], getattr(params.noise, quantity))
            for number, quantity in enumerate(("position", "velocity", "effort"))
        }
        self._params = params
        self._altered = [
            quantity
            for quantity in self._errors
            if quantity not in params.sense
            or getattr(params.noise, quantity)
            or getattr(params.resolution, quantity) is not None
        ]
        # What every step reads: one call per body, and where its results go.
        groups: dict[int, list[Joint]] = {}
        for joint in joints:
            groups.setdefault(joint.body, []).append(joint)
        self._groups = [(body, [j.index for j in group]) for body, group in groups.items()]
        read = [joint for group in groups.values() for joint in group]
        self._order = None if read == self.joints else [read.index(joint) for joint in joints]
        # Returns the engine's state of each joint.
        self._read: Callable[[], Sequence[Any]] = self._read_groups
        if len(groups) == 1 and self._order is None:
            self._read = partial(self._engine.read, *self._groups[0])
        drives = [motors.drive_of[joint.name] for joint in joints]
        # The engine does not report what it applies directly.
        self._unreported = [
            (number, drive, index)
            for number, (drive, index) in enumerate(drives)
            if isinstance(drive, DirectTorque)
        ]
        targeted = [(drive, i) for drive, i in drives if isinstance(drive, PositionMotor)]
        self._targeted = targeted if len(targeted) == len(drives) else []
        self.description = describe_joints(self.joints, details)

    def sense(self, _t_ns: int = 0) -> JointState:
        """Return the readings; `target`, without noise, only if every joint has one.

        Raises PhysicsError when the simulation has diverged.
        """
        position: Values = []
        velocity: Values = []
        effort: Values = []
        for angle, speed, _, torque in self._read():
            position.append(angle)
            velocity.append(speed)
            effort.append(torque)
        effort = self.efforts or effort
        if not math.isfinite(sum(position) + sum(velocity)):
            self._check_finite(position, velocity)
        for number, drive, index in self._unreported:
            effort[number] = drive.applied[index]
        if not (self._altered or self._targeted):
            return JointState(position=position, velocity=velocity, effort=effort)
        rows: dict[str, Any] = {"position": position, "velocity": velocity, "effort": effort}
        rows |= {quantity: self._reading(quantity, rows[quantity]) for quantity in self._altered}
        target = [drive.target(index) for drive, index in self._targeted] or None
        return JointState(**rows, target=target)

    def _reading(self, quantity: str, values: Values) -> Values | None:
        """Return a reading of true values of one quantity; None: it is not sensed."""
        if quantity not in self._params.sense:
            return None
        reading = self._errors[quantity].disturb(values)
        resolution: float | None = getattr(self._params.resolution, quantity)
        if resolution is not None:
            reading = resolution * np.round(reading / resolution)
        return cast("Values", reading.tolist())

    def applied(self) -> Values:
        """Return the torques of the latest step as the engine reports them [N·m]."""
        return [state[3] for state in self._read()]

    def _read_groups(self) -> Sequence[Any]:
        states = [state for group in self._groups for state in self._engine.read(*group)]
        return states if self._order is None else [states[i] for i in self._order]

    def _check_finite(self, position: Values, velocity: Values) -> None:
        states = zip(self.joints, position, velocity, strict=True)
        diverged = [j.name for j, q, v in states if not (math.isfinite(q) and math.isfinite(v))]
        if diverged:
            raise PhysicsError(
                f"the simulation has diverged (joints {', '.join(diverged)}); use a shorter "
                "physics_step or smaller gains"
            )
