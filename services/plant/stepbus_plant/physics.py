"""PyBullet behind one seam: a client of its own per run, and its errors translated."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ParamSpec, TypeVar

import pybullet

from stepbus_schemas import WiringError

from .errors import PhysicsError
from .world import Body, World

P = ParamSpec("P")
R = TypeVar("R")

_TYPES = {pybullet.JOINT_REVOLUTE: "revolute", pybullet.JOINT_PRISMATIC: "prismatic"}


def _translated(method: Callable[P, R]) -> Callable[P, R]:
    """Return the method with PyBullet's errors turned into PhysicsError."""

    @functools.wraps(method)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return method(*args, **kwargs)
        except pybullet.error as exc:
            raise PhysicsError(f"pybullet: {method.__name__}: {exc}") from exc

    return call


@dataclass(frozen=True, kw_only=True)
class ModelJoint:
    """A joint as its URDF describes it; limits as in `Description.limits`."""

    index: int
    name: str
    type: str
    lower: float
    upper: float
    effort: float
    velocity: float


class Physics:
    """One world in PyBullet, in DIRECT mode.

    Every torque that is not asked for is off: the motors PyBullet switches on by itself, damping
    of links and joints, and the joint friction of the URDF. With that and the URDF's own inertias
    its dynamics agree with Pinocchio's to 1e-10 N·m.
    """

    def __init__(self, world: World, physics_ns: int) -> None:
        self._client: int = pybullet.connect(pybullet.DIRECT)
        if self._client < 0:
            raise PhysicsError("pybullet: no physics server could be started in this process")
        self._call = {"physicsClientId": self._client}
        # It changes the trajectory, so it comes before anything else.
        pybullet.setPhysicsEngineParameter(deterministicOverlappingPairs=1, **self._call)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=physics_ns / 1e9,
            numSubSteps=0,
            numSolverIterations=world.solver_iterations,
            **self._call,
        )
        pybullet.setGravity(*world.gravity, **self._call)

    def load(self, name: str, body: Body) -> int:
        """Load a body and return its number; raises WiringError when PyBullet cannot."""
        try:
            number: int = pybullet.loadURDF(
                body.urdf,
                basePosition=body.position,
                baseOrientation=pybullet.getQuaternionFromEuler(body.orientation_rpy),
                useFixedBase=body.fixed_base,
                flags=pybullet.URDF_USE_INERTIA_FROM_FILE,
                **self._call,
            )
        except pybullet.error as exc:
            raise WiringError(
                f"bodies.{name}.urdf: pybullet cannot read {body.urdf}; "
                "its reason is in this participant's log"
            ) from exc
        self._quieten(number, body)
        return number

    def _quieten(self, number: int, body: Body) -> None:
        said = {
            "lateralFriction": body.friction.lateral,
            "rollingFriction": body.friction.rolling,
            "spinningFriction": body.friction.spinning,
        }
        friction = {key: value for key, value in said.items() if value is not None}
        for link in range(-1, pybullet.getNumJoints(number, **self._call)):
            pybullet.changeDynamics(
                number,
                link,
                linearDamping=0,
                angularDamping=0,
                jointDamping=0,
                **friction,
                **self._call,
            )

    @_translated
    def joints(self, body: int) -> list[ModelJoint]:
        """Return the movable joints of a body, in the model's order.

        Raises WiringError on a joint with several degrees of freedom.
        """
        count = pybullet.getNumJoints(body, **self._call)
        rows = [pybullet.getJointInfo(body, index, **self._call) for index in range(count)]
        return [_model_joint(row) for row in rows if row[2] != pybullet.JOINT_FIXED]

    @_translated
    def set_joint(self, body: int, index: int, **dynamics: float) -> None:
        """Set damping and limits of a joint, by PyBullet's names."""
        pybullet.changeDynamics(body, index, **dynamics, **self._call)

    @_translated
    def place(self, body: int, index: int, position: float, velocity: float) -> None:
        """Put a joint somewhere [rad], at a velocity [rad/s], at once."""
        pybullet.resetJointState(body, index, position, velocity, **self._call)

    @_translated
    def drive_torques(self, body: int, indices: Sequence[int], torques: Sequence[float]) -> None:
        """Apply torques [N·m] during the next substep only."""
        pybullet.setJointMotorControlArray(
            body, indices, pybullet.TORQUE_CONTROL, forces=torques, **self._call
        )

    @_translated
    def drive_velocities(
        self,
        body: int,
        indices: Sequence[int],
        velocities: Sequence[float],
        efforts: Sequence[float],
    ) -> None:
        """Hold velocities [rad/s] with at most the given torques [N·m], until told otherwise."""
        pybullet.setJointMotorControlArray(
            body,
            indices,
            pybullet.VELOCITY_CONTROL,
            targetVelocities=velocities,
            forces=efforts,
            **self._call,
        )

    @_translated
    def drive_positions(
        self,
        body: int,
        indices: Sequence[int],
        positions: Sequence[float],
        velocities: Sequence[float],
        efforts: Sequence[float],
    ) -> None:
        """Follow positions [rad] with feed-forward velocities [rad/s] and limited torques [N·m]."""
        pybullet.setJointMotorControlArray(
            body,
            indices,
            pybullet.POSITION_CONTROL,
            targetPositions=positions,
            targetVelocities=velocities,
            forces=efforts,
            **self._call,
        )

    @_translated
    def states(self, body: int, indices: Sequence[int]) -> tuple[Any, ...]:
        """Return (position, velocity, reaction forces, motor torque) of each joint."""
        rows: tuple[Any, ...] = pybullet.getJointStates(body, indices, **self._call)
        return rows

    @_translated
    def step(self) -> None:
        """Advance by one substep."""
        pybullet.stepSimulation(**self._call)

    def close(self) -> None:
        """Give the client back; later calls raise PhysicsError."""
        if pybullet.isConnected(**self._call):
            pybullet.disconnect(**self._call)


def _model_joint(row: Sequence[Any]) -> ModelJoint:
    """Return a row of getJointInfo as ModelJoint; PyBullet marks "no limits" by lower > upper."""
    name = row[1].decode()
    if row[2] not in _TYPES:
        raise WiringError(
            f"joint {name!r} has several degrees of freedom; "
            "only revolute, continuous and prismatic joints are supported"
        )
    limited = row[8] <= row[9]
    return ModelJoint(
        index=row[0],
        name=name,
        type=_TYPES[row[2]] if limited or row[2] == pybullet.JOINT_PRISMATIC else "continuous",
        lower=row[8] if limited else -float("inf"),
        upper=row[9] if limited else float("inf"),
        effort=row[10],
        velocity=row[11],
    )
