"""The physics engine: headless PyBullet with a world loaded."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pybullet as bullet

from stepbus_participant import Mimic, mimics, parse_urdf, suggest, urdf_warnings
from stepbus_participant.parameters import Keys
from stepbus_plant.errors import PhysicsError
from stepbus_plant.joint import (
    Joint,
    is_fixed,
    is_movable,
    make_joint,
    name_uniquely,
    refuse_unsupported,
    with_efforts,
)
from stepbus_plant.models import loadable, pairs_without_collision
from stepbus_plant.params import Params
from stepbus_plant.stock import Item
from stepbus_plant.world import Body, JointSettings
from stepbus_plant.world_file import World
from stepbus_schemas import WiringError

_GEAR_ERP = 0.2
"""Share of a follower's error that a substep corrects."""
_GEAR_FORCE = 1e4
"""Largest force between a joint and its follower [N or N·m]."""
_STANDS = 1e-3
"""Gap below which a thing stands on what is beneath it [m]."""


class Physics:
    """A PyBullet client that holds a world.

    step_ns: length of a physics substep [ns]. params: default actuation of the joints, and effort
    limits that override the world's.
    joints: all movable joints, in the order of the world's bodies and of their models. fixed: names
    of the fixed ones. urdfs: each body's model as loaded, in the order of the bodies. notes: what
    the engine computes otherwise than the models say.
    Raises WiringError that lists every URDF that cannot be loaded, each with its line. `prepare`,
    which has to come before the first step, reports all other mistakes about joints.
    """

    def __init__(self, world: World, step_ns: int, params: Params) -> None:
        self.client: int = bullet.connect(bullet.DIRECT)
        self._source = world.source
        self._efforts = params.effort
        self._actuation = params.actuation
        self._problems: list[tuple[Keys, str]] = []
        self.fixed: set[str] = set()
        self.urdfs: list[bytes] = []
        self.notes: list[str] = []
        self._followers: dict[tuple[int, int], list[Joint]] = {}
        self._goods: list[int] = []
        try:
            self._set_up(world, step_ns)
            bodies = [
                (name, joint)
                for name, body in world.bodies.items()
                for joint in self._load(name, body, world)
            ]
            if any(where[-1] == "urdf" for where, _ in self._problems):
                world.source.refuse(self._problems)
            self.joints = name_uniquely(bodies)
        except BaseException:
            self.close()
            raise

    def prepare(self) -> None:
        """Set the limits, motors and start positions of all joints.

        Raises WiringError that lists every mistake about a joint in the world file, each with its
        line, or else those in the params.
        """
        self._source.refuse(self._problems)
        self.joints = with_efforts(self.joints, self._efforts)
        for joint in self.joints:
            self._prepare(joint)
        for leader, followers in self._followers.items():
            for follower in followers:
                self._couple(leader, follower)
        self._put_goods_to_sleep()

    def _put_goods_to_sleep(self) -> None:
        """Let goods that stand on something sleep from the start; others fall first."""
        if not self._goods:
            return
        bullet.performCollisionDetection(self.client)
        for number in self._goods:
            touches = bullet.getContactPoints(number, physicsClientId=self.client)
            if any(point[8] < _STANDS for point in touches):
                bullet.changeDynamics(
                    number,
                    -1,
                    activationState=bullet.ACTIVATION_STATE_ENABLE_SLEEPING
                    | bullet.ACTIVATION_STATE_SLEEP,
                    physicsClientId=self.client,
                )

    def _set_up(self, world: World, step_ns: int) -> None:
        # Not needed for repeatability, but it affects the trajectory: set it before anything else.
        bullet.setPhysicsEngineParameter(
            deterministicOverlappingPairs=1,
            numSolverIterations=world.solver_iterations,
            physicsClientId=self.client,
        )
        bullet.setTimeStep(step_ns * 1e-9, physicsClientId=self.client)
        bullet.setGravity(*world.gravity, physicsClientId=self.client)

    def _load(self, name: str, body: Body, world: World) -> list[Joint]:
        """Load one body and return its movable joints, named as in the URDF."""
        item = world.items.get(name)
        try:
            with loadable(body.urdf, None if item is None else item.make) as urdf:
                root = parse_urdf(urdf.read_text(encoding="utf-8"))
                refuse_unsupported(root, body.urdf)
                number: int = bullet.loadURDF(
                    str(urdf),
                    basePosition=body.position,
                    baseOrientation=bullet.getQuaternionFromEuler(body.orientation_rpy),
                    useFixedBase=body.fixed_base,
                    flags=_flags(body, item),
                    physicsClientId=self.client,
                )
                self.urdfs.append(urdf.read_bytes())
                self.notes += [f"body {name}: {note}" for note in urdf_warnings(root)]
        except bullet.error as exc:
            self._problems.append((("bodies", name, "urdf"), f"{body.urdf}: {exc}"))
            return []
        except WiringError as exc:
            self._problems.append((("bodies", name, "urdf"), str(exc)))
            return []
        if world.sleeping:
            self._allow_sleep(number)
            self._goods += [] if item is None else [number]
        self._set_dynamics(number, body)
        self._disable_collisions(number, name, body)
        return self._joints_of(number, name, body, mimics(root))

    def _set_dynamics(self, number: int, body: Body) -> None:
        """Remove PyBullet's default damping and velocity limit, and set each link's friction."""
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
        # By default PyBullet limits every velocity to 100 rad/s, which hides a divergence.
        bullet.changeDynamics(number, -1, maxJointVelocity=math.inf, physicsClientId=self.client)

    def _allow_sleep(self, number: int) -> None:
        """Let a body without motors sleep once it is at rest; motors do not wake a body up."""
        if not any(is_movable(info) for info in self._infos(number)):
            bullet.changeDynamics(
                number,
                -1,
                activationState=bullet.ACTIVATION_STATE_ENABLE_SLEEPING,
                physicsClientId=self.client,
            )

    def _disable_collisions(self, number: int, name: str, body: Body) -> None:
        """Disable the self-collisions of a body that its SRDF rules out."""
        if body.srdf is None:
            return
        try:
            pairs = pairs_without_collision(body.srdf)
        except WiringError as exc:
            self._problems.append((("bodies", name, "srdf"), str(exc)))
            return
        links = {bullet.getBodyInfo(number, self.client)[0].decode(): -1}
        links |= {info[12].decode(): info[0] for info in self._infos(number)}
        unknown = dict.fromkeys(link for pair in pairs for link in pair if link not in links)
        self._problems += [
            (
                ("bodies", name, "srdf"),
                f"{body.srdf}: link {link!r} is unknown{suggest(link, links)}",
            )
            for link in unknown
        ]
        for first, second in pairs:
            if first not in unknown and second not in unknown:
                bullet.setCollisionFilterPair(
                    number, number, links[first], links[second], 0, physicsClientId=self.client
                )

    def _infos(self, body: int) -> list[Sequence[Any]]:
        return [bullet.getJointInfo(body, n, self.client) for n in range(self._count(body))]

    def _count(self, body: int) -> int:
        count: int = bullet.getNumJoints(body, physicsClientId=self.client)
        return count

    def _joints_of(
        self, number: int, name: str, body: Body, followed: Mapping[str, Mimic]
    ) -> list[Joint]:
        infos = self._infos(number)
        joints = [
            make_joint(number, info, self._settings(info, body), self._actuation)
            for info in infos
            if is_movable(info)
        ]
        self.fixed |= {info[1].decode() for info in infos if is_fixed(info)}
        joints = self._coupled(joints, name, body, followed)
        self._check_joints(name, body, joints)
        if not body.fixed_base and joints and not any(self._has_shape(number)):
            text = "it is not fixed to the world and has no collision shape, so it falls"
            self.notes.append(f"body {name}: {text}; is `fixed_base: true` missing?")
        return joints

    def _has_shape(self, number: int) -> Iterator[bool]:
        for link in range(-1, self._count(number)):
            yield bool(bullet.getCollisionShapeData(number, link, self.client))

    def _coupled(
        self, joints: Sequence[Joint], name: str, body: Body, followed: Mapping[str, Mimic]
    ) -> list[Joint]:
        """Return the joints of a body, those with <mimic> as followers of others."""
        by_name = {joint.name: joint for joint in joints}
        coupled = []
        for joint in joints:
            mimic, own = followed.get(joint.name), body.joints.get(joint.name, JointSettings())
            if mimic is None or own.mimic is False:
                coupled.append(joint)
                continue
            leader = by_name[mimic.joint]
            follower = joint.follow(leader, mimic)
            coupled.append(follower)
            self._followers.setdefault((leader.body, leader.index), []).append(follower)
            for key in ("position", "velocity", "mode"):
                if getattr(own, key) is not None:
                    text = (
                        f"follows joint {mimic.joint!r} (<mimic>); leave it out, or `mimic: false`"
                    )
                    self._problems.append((("bodies", name, "joints", joint.name, key), text))
        return coupled

    def _settings(self, info: Sequence[Any], body: Body) -> JointSettings:
        return body.joints.get(info[1].decode(), JointSettings()).over(body.joint_defaults)

    def _check_joints(self, name: str, body: Body, joints: Sequence[Joint]) -> None:
        known = [joint.name for joint in joints]
        self._problems += [
            (("bodies", name, "joints", given), f"unknown{suggest(given, known)}")
            for given in body.joints
            if given not in known
        ]
        for joint in joints:
            keys = ("joints", joint.name) if joint.name in body.joints else ("joint_defaults",)
            self._problems += [
                (("bodies", name, *keys), f"joint {joint.name}: {text}")
                for text in joint.problems()
            ]

    def _prepare(self, joint: Joint) -> None:
        """Set the limits, damping and start state of a joint, and disable its default motor."""
        limits = {}
        if math.isfinite(joint.lower):
            limits = {"jointLowerLimit": joint.lower, "jointUpperLimit": joint.upper}
        bullet.changeDynamics(
            joint.body,
            joint.index,
            jointDamping=joint.damping,
            physicsClientId=self.client,
            **limits,
        )
        self.teleport(joint, joint.start, joint.start_velocity)
        bullet.setJointMotorControl2(
            joint.body,
            joint.index,
            bullet.VELOCITY_CONTROL,
            targetVelocity=0.0,
            force=joint.friction,
            physicsClientId=self.client,
        )

    def _couple(self, leader: tuple[int, int], follower: Joint) -> None:
        """Let the engine keep a follower where its leader takes it, as by gears."""
        body, index = leader
        zero = (0.0, 0.0, 0.0)
        gear = bullet.createConstraint(
            body,
            follower.index,
            body,
            index,
            bullet.JOINT_GEAR,
            jointAxis=(1.0, 0.0, 0.0),
            parentFramePosition=zero,
            childFramePosition=zero,
            physicsClientId=self.client,
        )
        mimic = follower.mimic or Mimic(joint="")
        bullet.changeConstraint(
            gear,
            gearRatio=-mimic.multiplier,
            relativePositionTarget=mimic.offset,
            erp=_GEAR_ERP,
            maxForce=_GEAR_FORCE,
            physicsClientId=self.client,
        )

    def teleport(self, joint: Joint, position: float, velocity: float) -> None:
        """Set position [rad] and velocity [rad/s] of a joint, regardless of forces.

        Those that follow it go along; a follower alone stays where it is.
        """
        if joint.mimic is not None:
            return
        bullet.resetJointState(
            joint.body, joint.index, position, velocity, physicsClientId=self.client
        )
        for follower in self._followers.get((joint.body, joint.index), ()):
            if (mimic := follower.mimic) is not None:
                bullet.resetJointState(
                    follower.body,
                    follower.index,
                    mimic.multiplier * position + mimic.offset,
                    mimic.multiplier * velocity,
                    physicsClientId=self.client,
                )

    def wake(self, body: int) -> None:
        """Wake up a body: a sleeping one would stay where it is put, even in the air."""
        bullet.changeDynamics(
            body,
            -1,
            activationState=bullet.ACTIVATION_STATE_WAKE_UP,
            physicsClientId=self.client,
        )

    def read(self, body: int, indices: list[int]) -> Any:
        """Return PyBullet's (position, velocity, reaction, applied torque) of joints of a body."""
        return bullet.getJointStates(body, indices, self.client)

    def step(self) -> None:
        """Advance by one substep.

        Raises PhysicsError when PyBullet does.
        """
        try:
            bullet.stepSimulation(self.client)
        except bullet.error as exc:
            raise PhysicsError(f"the physics engine failed: {exc}") from exc

    def close(self) -> None:
        """Disconnect from the physics engine; harmless when repeated."""
        if self.client >= 0:
            bullet.disconnect(physicsClientId=self.client)
            self.client = -1


def _flags(body: Body, item: Item | None) -> int:
    # Without it PyBullet guesses inertias from the shapes, and is badly wrong.
    flags: int = bullet.URDF_USE_INERTIA_FROM_FILE
    if body.srdf is not None:
        flags |= bullet.URDF_USE_SELF_COLLISION
    if not body.visuals:
        flags |= bullet.URDF_IGNORE_VISUAL_SHAPES
    if item is not None:
        # A cylinder made of 32 faces has a collision margin and would stand 1 mm higher.
        flags |= bullet.URDF_USE_IMPLICIT_CYLINDER
    return flags
