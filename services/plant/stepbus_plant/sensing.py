"""Joint states: true ones, as the engine has them, turned into sensor readings."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from stepbus_plant.drives import DirectTorque, Motors, PositionMotor
from stepbus_plant.engine import PhysicsError
from stepbus_plant.joint import Joint, describe_joints
from stepbus_plant.params import Params
from stepbus_schemas import JointState

Values = list[float]
"""One number per sensed joint."""


class JointSensor:
    """Reads the states of joints.

    joints: sensed joints, in order. details: added to the description. seed: of the noise; each
    quantity has its own random stream, so that the noise on one does not change the noise on
    another. efforts: torques of the latest step [N·m] after a restart from a checkpoint, which the
    engine does not know then; else empty.
    """

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
        self._random = [np.random.PCG64([seed, number]) for number in range(3)]
        self._measure = {
            quantity: _measurement(params, quantity, np.random.Generator(random))
            for quantity, random in zip(
                ("position", "velocity", "effort"), self._random, strict=True
            )
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

    def save(self) -> list[tuple[str, str]]:
        """Return how far each random stream is, for a checkpoint."""
        states = [random.state["state"] for random in self._random]
        return [(str(state["state"]), str(state["inc"])) for state in states]

    def restore(self, saved: Sequence[tuple[str, str]]) -> None:
        """Take what `save` returned."""
        for random, (state, increment) in zip(self._random, saved, strict=True):
            random.state = {**random.state, "state": {"state": int(state), "inc": int(increment)}}


def _measurement(
    params: Params, quantity: str, random: np.random.Generator
) -> Callable[[Values], Values | None]:
    """Return the function from true to sensed values of one quantity."""
    noise: float = getattr(params.noise, quantity)
    resolution: float | None = getattr(params.resolution, quantity)

    def disturbed(values: Values) -> Values:
        sensed = np.asarray(values)
        if noise:
            sensed = sensed + noise * random.standard_normal(len(values))
        if resolution is not None:
            sensed = resolution * np.round(sensed / resolution)
        disturbed: Values = sensed.tolist()
        return disturbed

    if quantity not in params.sense:
        return lambda _: None
    return disturbed if noise or resolution is not None else lambda values: values
