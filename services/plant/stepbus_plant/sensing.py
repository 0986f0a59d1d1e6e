"""Joint states: true ones, as the engine has them, turned into sensor readings."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

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
        self._measure = {
            quantity: _measurement(params, quantity, errors)
            for quantity, errors in self._errors.items()
        }
        # What every step reads: one call per body, and where its results go.
        groups: dict[int, list[Joint]] = {}
        for joint in joints:
            groups.setdefault(joint.body, []).append(joint)
        self._groups = [(body, [j.index for j in group]) for body, group in groups.items()]
        read = [joint for group in groups.values() for joint in group]
        self._order = None if read == self.joints else [read.index(joint) for joint in joints]
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
        states = self._read()
        position: Values = [state[0] for state in states]
        velocity: Values = [state[1] for state in states]
        effort: Values = self.efforts or [state[3] for state in states]
        if not math.isfinite(sum(position) + sum(velocity)):
            self._check_finite(position, velocity)
        for number, drive, index in self._unreported:
            effort[number] = drive.torque(index)
        measure = self._measure
        return JointState(
            position=measure["position"](position),
            velocity=measure["velocity"](velocity),
            effort=measure["effort"](effort),
            target=[drive.target(index) for drive, index in self._targeted] or None,
        )

    def applied(self) -> Values:
        """Return the torques of the latest step as the engine reports them [N·m]."""
        return [state[3] for state in self._read()]

    def _read(self) -> Sequence[Any]:
        """Return the engine's state of each joint."""
        if len(self._groups) == 1:
            states: Sequence[Any] = self._engine.read(*self._groups[0])
        else:
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


def _measurement(
    params: Params, quantity: str, errors: Errors
) -> Callable[[Values], Values | None]:
    """Return the function from true to sensed values of one quantity."""
    noise: float = getattr(params.noise, quantity)
    resolution: float | None = getattr(params.resolution, quantity)

    def disturbed(values: Values) -> Values:
        sensed = errors.disturb(values)
        if resolution is not None:
            sensed = resolution * np.round(sensed / resolution)
        disturbed: Values = sensed.tolist()
        return disturbed

    if quantity not in params.sense:
        return lambda _: None
    return disturbed if noise or resolution is not None else lambda values: values
