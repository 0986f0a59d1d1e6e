"""The physics engine: PyBullet without a window, loaded with a world."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import pybullet as bullet

from stepbus.settings import nearest
from stepbus_schemas import WiringError
from stepbus_schemas.messages import JointMode

from .errors import PhysicsError
from .world import Actuation, Body, JointSettings, World

_MOVABLE = {bullet.JOINT_REVOLUTE: "revolute", bullet.JOINT_PRISMATIC: "prismatic"}


@dataclass(frozen=True, kw_only=True)
class Joint:
    """One movable joint of the world.

    name: unique in the world; `body/joint` where two bodies share it. body, index: PyBullet's
    numbers of it. lower, upper: stops [rad]. effort: largest torque [N·m]. max_velocity: largest
    commanded velocity [rad/s]. friction: Coulomb friction [N·m]. start, start_velocity: at t = 0.
    Prismatic joints have [m] and [N] in place of [rad] and [N·m].
    """

    name: str
    body: int
    index: int
    kind: str
    lower: float
    upper: float
    effort: float
    max_velocity: float
    mode: JointMode
    actuation: Actuation
    friction: float
    start: float
    start_velocity: float


class Physics:
    """One PyBullet client with everything in it; a fresh one per run.

    step_ns: length of a physics substep [ns]. joints: all movable ones, in the models' order.
    Raises WiringError for a URDF that cannot be loaded or a joint that it does not have.
    """

    def __init__(self, world: World, step_ns: int, actuation: Actuation) -> None:
        self.client: int = bullet.connect(bullet.DIRECT)
        try:
            self._set_up(world, step_ns)
            found = [
                joint
                for name, body in world.bodies.items()
                for joint in self._load(name, body, actuation)
            ]
        except BaseException:
            self.close()
            raise
        self.joints = _unique(found)

    def _set_up(self, world: World, step_ns: int) -> None:
        # Not needed for repeatability, but it changes the trajectory: set it once, at once.
        bullet.setPhysicsEngineParameter(
            deterministicOverlappingPairs=1,
            numSolverIterations=world.solver_iterations,
            physicsClientId=self.client,
        )
        bullet.setTimeStep(step_ns * 1e-9, physicsClientId=self.client)
        bullet.setGravity(*world.gravity, physicsClientId=self.client)

    def _load(self, name: str, body: Body, actuation: Actuation) -> list[tuple[str, Joint]]:
        """Load one body; return its movable joints with the body's name."""
        try:
            number: int = bullet.loadURDF(
                body.urdf,
                basePosition=body.position,
                baseOrientation=bullet.getQuaternionFromEuler(body.orientation_rpy),
                useFixedBase=body.fixed_base,
                # Without it PyBullet guesses inertias from the shapes, and is badly wrong.
                flags=bullet.URDF_USE_INERTIA_FROM_FILE,
                physicsClientId=self.client,
            )
        except bullet.error as exc:
            raise WiringError(f"bodies.{name}.urdf: {body.urdf} cannot be loaded: {exc}") from exc
        self._still(number, body)
        joints = [self._joint(number, i, body, actuation) for i in range(self._count(number))]
        movable = [joint for joint in joints if joint is not None]
        known = [joint.name for joint in movable]
        for wanted in body.joints:
            if wanted not in known:
                raise WiringError(
                    f"bodies.{name}.joints.{wanted}: unknown; {nearest(wanted, known)}"
                )
        return [(name, joint) for joint in movable]

    def _count(self, body: int) -> int:
        count: int = bullet.getNumJoints(body, physicsClientId=self.client)
        return count

    def _still(self, number: int, body: Body) -> None:
        """Take PyBullet's own damping away, and set the friction of each link."""
        friction = {
            f"{key}Friction": value
            for key in ("lateral", "rolling", "spinning")
            if (value := getattr(body.friction, key)) is not None
        }
        for link in range(-1, self._count(number)):
            bullet.changeDynamics(
                number,
                link,
                linearDamping=0.0,
                angularDamping=0.0,
                jointDamping=0.0,
                physicsClientId=self.client,
                **friction,
            )

    def _joint(self, number: int, index: int, body: Body, actuation: Actuation) -> Joint | None:
        info = bullet.getJointInfo(number, index, physicsClientId=self.client)
        if info[2] not in _MOVABLE:
            return None
        name = info[1].decode()
        settings = body.joints.get(name, JointSettings()).over(body.joint_defaults)
        joint = _make_joint(name, number, info, settings, actuation)
        self._prepare(joint, settings)
        return joint

    def _prepare(self, joint: Joint, settings: JointSettings) -> None:
        """Set the limits, damping and start of a joint, and still its default motor."""
        limits = {}
        if math.isfinite(joint.lower) and math.isfinite(joint.upper):
            limits = {"jointLowerLimit": joint.lower, "jointUpperLimit": joint.upper}
        bullet.changeDynamics(
            joint.body,
            joint.index,
            jointDamping=settings.damping or 0.0,
            physicsClientId=self.client,
            **limits,
        )
        self.put(joint, joint.start, joint.start_velocity)
        bullet.setJointMotorControl2(
            joint.body,
            joint.index,
            bullet.VELOCITY_CONTROL,
            targetVelocity=0.0,
            force=joint.friction,
            physicsClientId=self.client,
        )

    def put(self, joint: Joint, position: float, velocity: float) -> None:
        """Set position and velocity of a joint, without regard to forces."""
        bullet.resetJointState(
            joint.body, joint.index, position, velocity, physicsClientId=self.client
        )

    def read(self, body: int, indices: list[int]) -> Any:
        """Return PyBullet's (position, velocity, reaction, applied torque) of joints of a body."""
        return bullet.getJointStates(body, indices, physicsClientId=self.client)

    def step(self) -> None:
        """Advance by one substep.

        Raises PhysicsError when PyBullet does.
        """
        try:
            bullet.stepSimulation(physicsClientId=self.client)
        except bullet.error as exc:
            raise PhysicsError(f"the physics engine failed: {exc}") from exc

    def close(self) -> None:
        """Leave the physics engine; harmless when repeated."""
        if self.client >= 0:
            bullet.disconnect(physicsClientId=self.client)
            self.client = -1


def _make_joint(
    name: str,
    body: int,
    info: Any,
    settings: JointSettings,
    actuation: Actuation,
) -> Joint:
    """Return a joint from its URDF and the settings over it."""
    lower, upper = info[8], info[9]
    if lower > upper:  # how PyBullet says that a joint has no limits
        lower, upper = -math.inf, math.inf
    lower = lower if settings.lower is None else settings.lower
    upper = upper if settings.upper is None else settings.upper
    start = min(max(0.0, lower), upper) if settings.position is None else settings.position
    if not lower <= start <= upper:
        raise WiringError(
            f"joint {name}: position {start} at the start is outside of its limits "
            f"[{lower}, {upper}]"
        )
    return Joint(
        name=name,
        body=body,
        index=info[0],
        kind=_MOVABLE[info[2]],
        lower=lower,
        upper=upper,
        effort=info[10] if settings.effort is None else settings.effort,
        max_velocity=info[11] if settings.max_velocity is None else settings.max_velocity,
        mode=settings.mode or "torque",
        actuation=settings.actuation or actuation,
        friction=settings.friction or 0.0,
        start=start,
        start_velocity=settings.velocity or 0.0,
    )


def _unique(found: Iterable[tuple[str, Joint]]) -> list[Joint]:
    """Return joints with unique names: `body/joint` where bodies share one."""
    rows = list(found)
    counts = Counter(joint.name for _, joint in rows)
    return [
        joint
        if counts[joint.name] == 1
        else Joint(**{**vars(joint), "name": f"{body}/{joint.name}"})
        for body, joint in rows
    ]
