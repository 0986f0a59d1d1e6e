"""PyBullet: the reference, whose recordings have the same bytes on every machine.

PyBullet 3.2.7 takes an STL written as text for a mesh without triangles: the link has no shape, and
a camera does not see it. Of a file that is no STL, OBJ or DAE, it says that the URDF cannot be
loaded.
"""

import contextlib
import math
import os
import re
import tempfile
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from operator import itemgetter
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from stepbus_models import RobotDescription, Shape, urdf_text
from stepbus_participant import installed_version, scratch_folder
from stepbus_plant.engine import (
    ANY_BODY,
    ANY_LINK,
    BASE,
    REST,
    Contact,
    Engine,
    Gear,
    Goal,
    Indices,
    Light,
    Link,
    Loading,
    Motion,
    PhysicsError,
    Values,
)
from stepbus_plant.geometry import Array, Geometry, Pose
from stepbus_plant.meshes import binary_stl, is_text_stl
from stepbus_schemas import Point, Quaternion, WiringError

# What the engine gives a moving link: collision group, and groups that it collides with.
_GROUP, _ALL_GROUPS = 1, -1
_WHITE = (1.0, 1.0, 1.0)
_NOTHING = 1.0 - 1e-7
"""Depth from which on there is nothing: TinyRenderer rounds its 1 in single precision."""
_MOST_JOINTS = 127
_READS = (".stl", ".obj", ".dae")


def _import_pybullet() -> Any:
    """Import PyBullet without its greeting on stderr, in C: the date on which it was built.

    In a log, it would be the last thing a plant said.
    """
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        return import_module("pybullet")
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


bullet = _import_pybullet()
empty_clients: list[int] = []
left_clients: list[int] = []
"""Of closed worlds. To connect one takes ten times as long as to empty it."""


def prepare() -> None:
    """Connect a client for processes that are forked from this one, which share its 30 MB."""
    empty_clients.append(bullet.connect(bullet.DIRECT))


def _empty_client() -> int:
    if not empty_clients and left_clients:
        # Not when its world was closed: most processes end then.
        bullet.resetSimulation(physicsClientId=left_clients[-1])
        empty_clients.append(left_clients.pop())
    client: int = empty_clients.pop() if empty_clients else bullet.connect(bullet.DIRECT)
    return client


class BulletGeometry(Geometry):
    """PyBullet's own geometry, in single precision."""

    def compose(self, one: Pose, other: Pose) -> Pose:
        """See `Geometry`."""
        pose: Pose = bullet.multiplyTransforms(*one, *other)
        return pose

    def inverse(self, pose: Pose) -> Pose:
        """See `Geometry`."""
        inverted: Pose = bullet.invertTransform(*pose)
        return inverted

    def turned(self, orientation: Quaternion, direction: Point) -> Point:
        """See `Geometry`."""
        in_world: Point = bullet.rotateVector(orientation, direction)
        return in_world


class BulletEngine(Engine):
    """A headless PyBullet client, see `Engine`. client: its number."""

    name = "pybullet"

    def __init__(self, step_s: float, gravity: Point, solver_iterations: int) -> None:
        self.geometry: Geometry = BulletGeometry()
        self.client = _empty_client()
        self._here = {"physicsClientId": self.client}
        self._to_frame: dict[int, Pose] = {}
        self._watched: list[Link] = []
        self._reactions: dict[Link, Any] = {}
        self._compounds: list[int] = []
        self._sleepers: list[int] = []
        # Not needed for repeatability, but it affects the trajectory: set it before anything else.
        bullet.setPhysicsEngineParameter(
            deterministicOverlappingPairs=1,
            numSolverIterations=solver_iterations,
            # With it, a joint that is 0.04 rad or m past its stop stays there; contacts ignore it.
            useSplitImpulse=0,
            **self._here,
        )
        bullet.setTimeStep(step_s, **self._here)
        bullet.setGravity(*gravity, **self._here)

    def step(self) -> None:
        """Advance by one substep; raises PhysicsError when PyBullet fails."""
        if self._reactions:
            self._reactions = {}
        try:
            bullet.stepSimulation(self.client)
        except bullet.error as exc:
            raise PhysicsError(
                f"PyBullet failed in a physics step: {exc}; try a smaller physics_step"
            ) from exc

    def unsaved(self, names: Sequence[str]) -> str:
        """See `Engine`.

        PyBullet 3.2.7 keeps the cached points of contacts of two convex shapes, with which the next
        substep goes on to the same bits. It does not keep how long a body has been at rest, and
        mixes up the points of a link with several shapes, or with a concave one.
        """
        if self._sleepers:
            who = names[self._sleepers[0]]
            return f"PyBullet does not keep how long {who} has been at rest (`sleeping`)"
        for body in self._compounds:
            if bullet.getContactPoints(body, **self._here):
                what = f"{names[body]}, which has a link with several shapes or a concave one"
                return f"PyBullet does not keep the contacts of {what}"
        return ""

    def save(self) -> bytes:
        """See `Engine`; raises OSError and PhysicsError where its file cannot be written."""
        with tempfile.TemporaryDirectory(prefix="stepbus-state-", dir=scratch_folder()) as folder:
            file = Path(folder) / "world.bullet"
            try:
                bullet.saveBullet(str(file), **self._here)
            except bullet.error as exc:
                raise PhysicsError(f"PyBullet cannot write to {folder}: {exc}") from exc
            world = zlib.compress(file.read_bytes(), 1)
        # It keeps no reactions.
        reactions = [bullet.getJointState(*joint, self.client)[2] for joint in self._watched]
        return msgspec.msgpack.encode((world, reactions))

    def restore(self, state: bytes) -> None:
        """See `Engine`."""
        world, reactions = msgspec.msgpack.decode(state)
        # In a new folder: what PyBullet has read under one name, it takes from its memory.
        with tempfile.TemporaryDirectory(prefix="stepbus-state-", dir=scratch_folder()) as folder:
            file = Path(folder) / "world.bullet"
            file.write_bytes(zlib.decompress(world))
            bullet.restoreState(fileName=str(file), **self._here)
        self._reactions = dict(zip(self._watched, reactions, strict=True))

    def renderer(self) -> str:
        """See `Engine`."""
        return f"TinyRenderer of pybullet {installed_version('pybullet')}"

    def close(self) -> None:
        """Leave the client to the next world; harmless when repeated."""
        if self.client >= 0:
            left_clients.append(self.client)
            self.client = -1

    # --- bodies ---------------------------------------------------------------------------

    def load(self, robot: RobotDescription, pose: Pose, options: Loading) -> int:
        """See `Engine`; other cylinders are meshes of 32 faces, whose margin lifts them by 1 mm."""
        if robot.format == "mjcf":
            text = "is an MJCF, which engine pybullet does not read; use `engine: mujoco`"
            raise WiringError(f"{robot.path}: {text}")
        if len(robot.joints) > _MOST_JOINTS:
            text = f"has {len(robot.joints)} joints, fixed ones included, and engine pybullet takes"
            raise WiringError(f"{robot.path}: {text} {_MOST_JOINTS}; use `engine: mujoco`")
        # Without it PyBullet guesses inertias from the shapes, and is badly wrong.
        flags = bullet.URDF_USE_INERTIA_FROM_FILE
        flags |= bullet.URDF_USE_SELF_COLLISION if options.collides_with_itself else 0
        flags |= 0 if options.has_visuals else bullet.URDF_IGNORE_VISUAL_SHAPES
        flags |= bullet.URDF_USE_IMPLICIT_CYLINDER if options.is_smooth else 0
        try:
            with written(robot) as urdf:
                body: int = bullet.loadURDF(
                    str(urdf), *pose, useFixedBase=options.is_fixed, flags=flags, **self._here
                )
        except bullet.error as exc:
            raise WiringError(str(exc)) from exc
        undamped = {"linearDamping": 0.0, "angularDamping": 0.0, "jointDamping": 0.0}
        frictions = {f"{key}Friction": value for key, value in options.friction.items()}
        for link in range(BASE, bullet.getNumJoints(body, **self._here)):
            bullet.changeDynamics(body, link, **undamped, **frictions, **self._here)
        shapes = [link.collisions for link in robot.links.values()]
        if any(len(own) > 1 or any(map(_is_compound, own)) for own in shapes):
            self._compounds.append(body)
        # By default PyBullet limits every velocity to 100 rad/s, which hides a divergence.
        bullet.changeDynamics(body, BASE, maxJointVelocity=math.inf, **self._here)
        return body

    def _infos(self, body: int) -> list[Any]:
        count = bullet.getNumJoints(body, **self._here)
        return [bullet.getJointInfo(body, index, self.client) for index in range(count)]

    def joints(self, body: int) -> list[str]:
        """See `Engine`."""
        return [info[1].decode() for info in self._infos(body)]

    def links(self, body: int) -> dict[str, Link]:
        """See `Engine`."""
        root = bullet.getBodyInfo(body, self.client)[0].decode()
        children = {info[12].decode(): (body, info[0]) for info in self._infos(body)}
        return {root: (body, BASE), **children}

    def is_solid(self, link: Link) -> bool:
        """See `Engine`."""
        return bool(bullet.getCollisionShapeData(*link, **self._here))

    def let_through(self, one: Link, other: Link) -> None:
        """See `Engine`."""
        bullet.setCollisionFilterPair(one[0], other[0], one[1], other[1], 0, **self._here)

    def let_sleep(self, body: int, *, now: bool = False) -> None:
        """Skip a body once it is at rest, or from now on, until something moves it."""
        self._sleepers += [body] if self.mass((body, BASE)) else []
        state = bullet.ACTIVATION_STATE_ENABLE_SLEEPING
        state |= bullet.ACTIVATION_STATE_SLEEP if now else 0
        bullet.changeDynamics(body, BASE, activationState=state, **self._here)

    def wake(self, body: int) -> None:
        """Wake up a body: a sleeping one would stay where it is put, even in the air."""
        state = bullet.ACTIVATION_STATE_WAKE_UP
        bullet.changeDynamics(body, BASE, activationState=state, **self._here)

    # --- joints ---------------------------------------------------------------------------

    def read(self, body: int, indices: Sequence[int]) -> Any:
        """See `Engine`."""
        return bullet.getJointStates(body, indices, self.client)

    def put_joint(self, body: int, index: int, position: float, velocity: float) -> None:
        """See `Engine`."""
        bullet.resetJointState(body, index, position, velocity, **self._here)

    def set_joint(
        self, body: int, index: int, *, damping: float, lower: float, upper: float
    ) -> None:
        """See `Engine`."""
        stops = {"jointLowerLimit": lower, "jointUpperLimit": upper} if lower > -math.inf else {}
        bullet.changeDynamics(body, index, jointDamping=damping, **stops, **self._here)

    def couple(self, body: int, follower: int, leader: int, gear: Gear) -> None:
        """See `Engine`."""
        origins = {"parentFramePosition": (0.0, 0.0, 0.0), "childFramePosition": (0.0, 0.0, 0.0)}
        pair, axis = (body, follower, body, leader), (1.0, 0.0, 0.0)
        made = bullet.createConstraint(
            *pair, bullet.JOINT_GEAR, jointAxis=axis, **origins, **self._here
        )
        bullet.changeConstraint(
            made,
            gearRatio=-gear.multiplier,
            relativePositionTarget=gear.offset,
            erp=gear.erp,
            maxForce=gear.force,
            **self._here,
        )

    def push(self, body: int, indices: Indices, torques: Values) -> None:
        """See `Engine`."""
        bullet.setJointMotorControlArray(
            body, indices, bullet.TORQUE_CONTROL, forces=torques, physicsClientId=self.client
        )

    def turn(self, body: int, indices: Indices, velocities: Values, torques: Values) -> None:
        """See `Engine`."""
        bullet.setJointMotorControlArray(
            body,
            indices,
            bullet.VELOCITY_CONTROL,
            targetVelocities=velocities,
            forces=torques,
            **self._here,
        )

    def bring(self, body: int, index: int, goal: Goal) -> None:
        """See `Engine`."""
        more = {"maxVelocity": goal.max_velocity} if goal.max_velocity > 0.0 else {}
        more |= {"positionGain": goal.gain, "velocityGain": 1.0} if goal.gain else {}
        bullet.setJointMotorControl2(
            body,
            index,
            bullet.POSITION_CONTROL,
            targetPosition=goal.position,
            targetVelocity=goal.velocity,
            force=goal.torque,
            **more,
            **self._here,
        )

    def watch_reaction(self, joint: Link) -> None:
        """See `Engine`."""
        bullet.enableJointForceTorqueSensor(*joint, True, self.client)
        self._watched.append(joint)

    def reaction(self, joint: Link) -> tuple[Array, Array]:
        """See `Engine`."""
        kept = self._reactions.get(joint)
        values = np.array(kept or bullet.getJointState(*joint, self.client)[2])
        return values[:3], values[3:]

    def shove(self, link: Link, force: Point, torque: Point) -> None:
        """See `Engine`."""
        if link[0] in self._sleepers:
            self.wake(link[0])
        # In a link's frame, PyBullet counts a position from the centre of mass, not in the world's.
        centre = self.motion(link).centre
        bullet.applyExternalForce(*link, force, centre, bullet.WORLD_FRAME, self.client)
        bullet.applyExternalTorque(*link, torque, bullet.WORLD_FRAME, self.client)

    # --- poses ----------------------------------------------------------------------------

    def mass(self, link: Link) -> float:
        """See `Engine`."""
        mass: float = bullet.getDynamicsInfo(*link, self.client)[0]
        return mass

    def inertial(self, link: Link) -> Pose:
        """See `Engine`."""
        pose: Pose = bullet.getDynamicsInfo(*link, self.client)[3:5]
        return pose

    def centre(self, body: int) -> Pose:
        """See `Engine`."""
        pose: Pose = bullet.getBasePositionAndOrientation(body, self.client)
        return pose

    def frame(self, link: Link) -> Pose:
        """See `Engine`."""
        body, index = link
        if index == BASE:
            if body not in self._to_frame:
                self._to_frame[body] = self.geometry.inverse(self.inertial(link))
            return self.geometry.compose(self.centre(body), self._to_frame[body])
        return self.frames(body, [index])[0]

    def frames(self, body: int, indices: Sequence[int]) -> list[Pose]:
        """See `Engine`."""
        states = bullet.getLinkStates(body, indices, computeForwardKinematics=True, **self._here)
        return [state[4:6] for state in states]

    def motion(self, link: Link) -> Motion:
        """See `Engine`."""
        body, index = link
        if index == BASE:
            velocity, spin = bullet.getBaseVelocity(body, self.client)
            return Motion(self.frame(link), self.centre(body)[0], velocity, spin)
        state = bullet.getLinkState(
            body, index, computeLinkVelocity=True, computeForwardKinematics=True, **self._here
        )
        return Motion(state[4:6], state[0], state[6], state[7])

    def put(self, body: int, frame: Pose, velocity: Point = REST, spin: Point = REST) -> None:
        """See `Engine`."""
        self.put_centre(body, self.geometry.compose(frame, self.inertial((body, BASE))))
        bullet.resetBaseVelocity(body, velocity, spin, **self._here)

    def put_centre(self, body: int, pose: Pose, *, keeps_velocity: bool = False) -> None:
        """See `Engine`."""
        velocity = bullet.getBaseVelocity(body, self.client) if keeps_velocity else None
        bullet.resetBasePositionAndOrientation(body, *pose, self.client)
        if velocity is not None:
            bullet.resetBaseVelocity(body, *velocity, **self._here)

    # --- contacts, rays, images -----------------------------------------------------------

    def update_shapes(self) -> None:
        """See `Engine`."""
        bullet.performCollisionDetection(self.client)

    def contacts(
        self, body: int = ANY_BODY, link: int = ANY_LINK, *, are_pressed: bool = False
    ) -> list[Contact]:
        """See `Engine`."""
        rows = bullet.getContactPoints(bodyA=body, linkIndexA=link, **self._here)
        # Which pair comes first depends on which touched first, and is not restored.
        rows = sorted(rows, key=itemgetter(1, 2, 3, 4))
        return _contacts([row for row in rows if row[9] > 0.0] if are_pressed else rows)

    def box(self, link: Link) -> tuple[Point, Point]:
        """See `Engine`."""
        corners: tuple[Point, Point] = bullet.getAABB(*link, self.client)
        return corners

    def closest(self, link: Link, within: float) -> list[Contact]:
        """See `Engine`.

        PyBullet makes boxes 20 mm larger than a link (gContactBreakingThreshold), which is more
        than it moves in a substep.
        """
        low, high = self.box(link)
        pairs = bullet.getOverlappingObjects(
            [x - within for x in low], [x + within for x in high], **self._here
        )
        own, index = link
        others = sorted({pair for pair in pairs or () if pair[0] != own})
        return [
            contact
            for body, other in others
            for contact in _contacts(
                bullet.getClosestPoints(own, body, within, index, other, **self._here)
            )
        ]

    def forget_contacts(self, link: Link) -> None:
        """Forget the contacts of a link, which the next substep then finds anew."""
        bullet.setCollisionFilterGroupMask(*link, _GROUP, _ALL_GROUPS, **self._here)

    def cast(self, starts: Array, ends: Array) -> Array:
        """See `Engine`."""
        hits = bullet.rayTestBatch(starts.tolist(), ends.tolist(), numThreads=1, **self._here)
        return np.array([hit[2] if hit[0] >= 0 else math.inf for hit in hits])

    def image(
        self, size: tuple[int, int], view: Array, projection: Array, light: Light
    ) -> tuple[NDArray[np.uint8], Array]:
        """See `Engine`."""
        # The renderer samples the corner of a pixel; shift by half a pixel to its centre.
        projection = projection.copy()
        projection[0, 2] += 1 / size[0]
        projection[1, 2] += 1 / size[1]
        _, _, rgba, depth, _ = bullet.getCameraImage(
            *size,
            viewMatrix=view.T.ravel().tolist(),
            projectionMatrix=projection.T.ravel().tolist(),
            renderer=bullet.ER_TINY_RENDERER,
            flags=bullet.ER_NO_SEGMENTATION_MASK,
            shadow=int(light.has_shadow),
            lightDirection=light.direction,
            lightColor=_WHITE,
            lightDistance=light.distance,
            lightAmbientCoeff=light.ambient,
            lightDiffuseCoeff=light.diffuse,
            lightSpecularCoeff=light.specular,
            **self._here,
        )
        width, height = size
        colours = np.reshape(np.asarray(rgba, dtype=np.uint8), (height, width, 4))[..., :3]
        buffer = np.asarray(depth, dtype=np.float64)
        return colours, np.where(buffer < _NOTHING, buffer, 1.0)


@contextmanager
def written(robot: RobotDescription) -> Iterator[Path]:
    """Provide the file of a robot that PyBullet reads, as a context manager.

    Raises WiringError for a mesh that cannot be read.
    """
    shapes = (s for link in robot.links.values() for s in (*link.visuals, *link.collisions))
    meshes = {shape.mesh: Path(shape.mesh) for shape in shapes if shape.kind == "mesh"}
    with tempfile.TemporaryDirectory(prefix="stepbus-urdf-", dir=scratch_folder()) as folder:
        copies: dict[str, Path] = {}
        for file, path in meshes.items():
            if path.suffix.lower() not in _READS or is_text_stl(path):
                copies[file] = Path(folder) / f"{len(copies)}.stl"
                copies[file].write_bytes(binary_stl(file))
        urdf = Path(folder) / "robot.urdf"
        urdf.write_bytes(urdf_text(robot, meshes=copies).encode())
        yield urdf


def _is_compound(shape: Shape) -> bool:
    """Return whether a mesh is concave, or several shapes: one for each object of an OBJ file."""
    if shape.is_concave:
        return True
    if shape.kind != "mesh" or not str(shape.mesh).lower().endswith(".obj"):
        return False
    with contextlib.suppress(OSError):
        return len(re.findall(rb"^o ", Path(shape.mesh).read_bytes(), re.MULTILINE)) > 1
    return False


def _contacts(rows: Iterable[Any]) -> list[Contact]:
    return [Contact((r[1], r[3]), (r[2], r[4]), r[5], r[6], r[7], r[8], r[9]) for r in rows]


ENGINE = BulletEngine
