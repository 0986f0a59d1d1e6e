"""The engine MuJoCo: bodies, joints, motors and poses of a compiled model."""

import logging
import math
from collections.abc import Sequence
from itertools import combinations
from typing import Any

import msgspec
import mujoco
import numpy as np
from numpy.typing import NDArray

from stepbus_models import RobotDescription
from stepbus_models.mjcf import one_line
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
from stepbus_plant.engines.mujoco.image import Painter
from stepbus_plant.engines.mujoco.model import Body, add, rigid
from stepbus_plant.engines.mujoco.motors import Motors, add_motor, motor_of
from stepbus_plant.engines.mujoco.shapes import Shapes, point
from stepbus_plant.geometry import Array, Geometry, Pose, rotation
from stepbus_schemas import Point, WiringError

# By default MuJoCo writes them into a file in the current folder.
mujoco.set_mju_user_warning(logging.getLogger("stepbus_plant").warning)

_FRICTION_RATIO = 10.0
_LEAST_RANGE = 1e-9
"""MuJoCo has no joint that is locked by its stops [rad]."""
_INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION
_RESTS = np.zeros(3), np.zeros(3)
_Numbers = NDArray[np.int64]


class _State(msgspec.Struct):
    """All that the next substep, or a reading before it, depends on; the plant sets motors anew.

    physics: MuJoCo's own, of mjSTATE_INTEGRATION. reactions: force [N] and torque [N·m] of joints.
    """

    physics: list[float]
    reactions: list[tuple[Link, list[float], list[float]]]
    contacts: list[Contact]


class MujocoEngine(Engine):
    """A world in MuJoCo, see `Engine`.

    The model is compiled when something first needs it; bodies, exceptions from collisions and
    gears come before.
    """

    name = "mujoco"
    _motors: Motors
    _shapes: Shapes

    def __init__(self, step_s: float, gravity: Point, solver_iterations: int) -> None:
        self.geometry = Geometry()
        self._spec, self._dt = mujoco.MjSpec(), step_s
        option = self._spec.option
        option.timestep, option.gravity = step_s, gravity
        option.iterations = solver_iterations
        # What MuJoCo recommends for grippers: otherwise what is held or lies aslant creeps.
        option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, _FRICTION_RATIO
        # Otherwise MuJoCo begins anew where a state has diverged. Rows of islands are copies.
        disabled = mujoco.mjtDisableBit
        option.disableflags |= disabled.mjDSBL_AUTORESET | disabled.mjDSBL_ISLAND
        self._spec.compiler.degree = False
        self._bodies: list[Body] = []
        self._is_seen = self._is_shoved = False
        self._compiled: tuple[Any, Any] | None = None
        self._painter: Painter | None = None
        self._id: dict[Link, int] = {}
        self._reactions: dict[Link, tuple[Array, Array]] = {}
        self._contacts: list[Contact] | None = None
        self._numbers: dict[tuple[int, tuple[int, ...]], tuple[_Numbers, _Numbers, _Numbers]] = {}

    def _now(self) -> tuple[Any, Any]:
        """Return the model and its data."""
        if self._compiled is None:
            self._compiled = self._compile()
        return self._compiled

    def _compile(self) -> tuple[Any, Any]:
        try:
            model = self._spec.compile()
        except (ValueError, mujoco.FatalError) as exc:
            raise PhysicsError(f"MuJoCo cannot build the world: {one_line(exc)}") from exc
        data = mujoco.MjData(model)
        self._id = {
            (body.number, n): model.body(body.body_name(n)).id
            for body in self._bodies
            for n in range(BASE, len(body.rows) - 1)
        }
        self._motors = Motors(model, self._dt)
        self._shapes = Shapes(model, data, self._id)
        return model, data

    def step(self) -> None:
        """See `Engine`."""
        model, data = self._now()
        self._contacts, self._is_seen = None, False
        self._motors.step(data)
        if self._reactions:
            self._feel(model, data)
        data.qfrc_applied.fill(0.0)
        if self._is_shoved:
            self._is_shoved = False
            data.xfrc_applied.fill(0.0)

    def _feel(self, model: Any, data: Any) -> None:
        """Keep the reactions of watched joints, as they were before the bodies moved."""
        mujoco.mj_rnePostConstraint(model, data)
        for link in self._reactions:
            body = self._id[link]
            torque, force = data.cfrc_int[body, :3], data.cfrc_int[body, 3:]
            about = data.subtree_com[model.body_rootid[body]]
            moved = torque + np.cross(about - data.xipos[body], force)
            turn = data.xmat[body].reshape(3, 3)
            self._reactions[link] = turn.T @ force, turn.T @ moved

    def close(self) -> None:
        """See `Engine`."""
        if self._painter is not None:
            self._painter.close()
            self._painter = None

    # --- state ----------------------------------------------------------------------------

    def save(self) -> bytes:
        """See `Engine`."""
        model, data = self._now()
        physics = np.empty(mujoco.mj_stateSize(model, _INTEGRATION))
        mujoco.mj_getState(model, data, physics, _INTEGRATION)
        return msgspec.msgpack.encode(
            _State(
                physics=physics.tolist(),
                reactions=[(at, f.tolist(), t.tolist()) for at, (f, t) in self._reactions.items()],
                contacts=self.contacts(),
            )
        )

    def restore(self, state: bytes) -> None:
        """See `Engine`."""
        saved, (model, data) = msgspec.msgpack.decode(state, type=_State), self._now()
        mujoco.mj_setState(model, data, np.array(saved.physics), _INTEGRATION)
        self._reactions = {link: (np.array(f), np.array(t)) for link, f, t in saved.reactions}
        self._contacts, self._is_seen = saved.contacts, False

    # --- bodies ---------------------------------------------------------------------------

    def load(self, robot: RobotDescription, pose: Pose, options: Loading) -> int:
        """See `Engine`; cylinders are always exact. An MJCF says itself what collides."""
        number = len(self._bodies)
        try:
            body = add(self._spec, robot, number, pose, options)
        except WiringError:
            raise
        except (ValueError, mujoco.FatalError) as exc:
            raise PhysicsError(f"MuJoCo cannot read it: {one_line(exc)}") from exc
        self._bodies.append(body)
        for index, joint in enumerate(self.joints(number)):
            if robot.joints[joint].moves:
                add_motor(self._spec, body.joint_name(index), self._dt)
        if robot.format == "urdf" and not options.collides_with_itself:
            for pair in combinations(filter(self.is_solid, self.links(number).values()), 2):
                self.let_through(*pair)
        return number

    def notes(self, body: int) -> list[str]:
        """See `Engine`."""
        return self._bodies[body].notes

    def joints(self, body: int) -> list[str]:
        """See `Engine`."""
        return [joint for _, joint in self._bodies[body].rows[1:]]

    def links(self, body: int) -> dict[str, Link]:
        """See `Engine`; the number of a link is that of the last joint before it."""
        rows = self._bodies[body].rows
        return {name.strip(): (body, n + BASE) for n, (name, _) in enumerate(rows)}

    def is_solid(self, link: Link) -> bool:
        """See `Engine`."""
        body, index = link
        return self._bodies[body].rows[index - BASE][0] in self._bodies[body].solid

    def let_through(self, one: Link, other: Link) -> None:
        """See `Engine`."""
        first, second = (self._bodies[body].body_name(link) for body, link in (one, other))
        self._spec.add_exclude(bodyname1=first, bodyname2=second)

    # --- joints ---------------------------------------------------------------------------

    def _numbers_of(self, body: int, indices: Sequence[int]) -> tuple[_Numbers, _Numbers, _Numbers]:
        """Return where joints have their position, and their velocity, and their motors."""
        model, _ = self._now()
        key = body, tuple(indices)
        if key not in self._numbers:
            names = [self._bodies[body].joint_name(index) for index in indices]
            joints = [model.joint(name) for name in names]
            found = (
                [joint.qposadr[0] for joint in joints],
                [joint.dofadr[0] for joint in joints],
                [model.tendon(motor_of(name)).id for name in names],
            )
            places, dofs, motors = (np.array(row, dtype=np.int64) for row in found)
            self._numbers[key] = places, dofs, motors
        return self._numbers[key]

    def read(self, body: int, indices: Sequence[int]) -> Any:
        """See `Engine`; without reactions."""
        places, dofs, motors = self._numbers_of(body, indices)
        _, data = self._now()
        positions, velocities = data.qpos[places].tolist(), data.qvel[dofs].tolist()
        nothing = [None] * len(positions)
        torques = self._motors.torques[motors].tolist()
        return list(zip(positions, velocities, nothing, torques, strict=True))

    def put_joint(self, body: int, index: int, position: float, velocity: float) -> None:
        """See `Engine`."""
        places, dofs, _ = self._numbers_of(body, [index])
        _, data = self._now()
        data.qpos[places], data.qvel[dofs] = position, velocity
        self._is_seen = False

    def set_joint(
        self, body: int, index: int, *, damping: float, lower: float, upper: float
    ) -> None:
        """See `Engine`; damping is implicit, and so always stable."""
        model, _ = self._now()
        joint = model.joint(self._bodies[body].joint_name(index))
        if damping != joint.damping[0]:
            joint.damping, model.dof_dampingpoly[joint.dofadr] = damping, 0.0
        joint.limited = math.isfinite(lower) and math.isfinite(upper)
        if joint.limited:
            joint.range = lower, max(upper, lower + _LEAST_RANGE)

    def couple(self, body: int, follower: int, leader: int, gear: Gear) -> None:
        """See `Engine`; as stiff as can be and without a limit, whatever the gear says."""
        name_of = self._bodies[body].joint_name
        self._spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=name_of(follower),
            name2=name_of(leader),
            data=[gear.offset, gear.multiplier, *[0.0] * 10],
            solref=rigid(self._dt),
        )

    def push(self, body: int, indices: Indices, torques: Values) -> None:
        """See `Engine`."""
        _, dofs, _ = self._numbers_of(body, indices)
        self._now()[1].qfrc_applied[dofs] = torques

    def turn(self, body: int, indices: Indices, velocities: Values, torques: Values) -> None:
        """See `Engine`."""
        self._motors.turn(self._numbers_of(body, indices)[2], velocities, torques)

    def bring(self, body: int, index: int, goal: Goal) -> None:
        """See `Engine`."""
        (motor,) = self._numbers_of(body, [index])[2]
        self._motors.bring(motor, goal)

    def watch_reaction(self, joint: Link) -> None:
        """See `Engine`."""
        self._reactions.setdefault(joint, _RESTS)

    def reaction(self, joint: Link) -> tuple[Array, Array]:
        """See `Engine`."""
        return self._reactions[joint]

    def shove(self, link: Link, force: Point, torque: Point) -> None:
        """See `Engine`."""
        _, data = self._now()
        data.xfrc_applied[self._id[link]] += (*force, *torque)
        self._is_shoved = True

    # --- poses ----------------------------------------------------------------------------

    def _looked(self) -> tuple[Any, Any]:
        """Return the model and its data, with all poses and velocities as they are now."""
        model, data = self._now()
        if not self._is_seen:
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            self._is_seen = True
        return model, data

    def mass(self, link: Link) -> float:
        """See `Engine`."""
        model, _ = self._now()
        is_fixed = self._bodies[link[0]].is_fixed and link[1] == BASE
        return 0.0 if is_fixed else float(model.body_mass[self._id[link]])

    def inertial(self, link: Link) -> Pose:
        """See `Engine`; along the axes of the link."""
        model, _ = self._now()
        return point(model.body_ipos[self._id[link]]), (0.0, 0.0, 0.0, 1.0)

    def frame(self, link: Link) -> Pose:
        """See `Engine`."""
        (_, data), number = self._looked(), self._id[link]
        w, i, j, k = data.xquat[number].tolist()
        return point(data.xpos[number]), (i, j, k, w)

    def motion(self, link: Link) -> Motion:
        """See `Engine`."""
        (model, data), frame, body = self._looked(), self.frame(link), self._id[link]
        found = np.empty(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, found, 0)
        return Motion(frame, point(data.xipos[body]), point(found[3:]), point(found[:3]))

    def _place(self, body: int, frame: Pose) -> None:
        """Put the root of a body somewhere, and leave its velocity."""
        (model, data), (place, (i, j, k, w)) = self._now(), frame
        number = self._id[body, BASE]
        if self._bodies[body].is_fixed:
            mocap = model.body_mocapid[number]
            data.mocap_pos[mocap], data.mocap_quat[mocap] = place, (w, i, j, k)
        else:
            at = model.jnt_qposadr[model.body_jntadr[number]]
            data.qpos[at : at + 7] = (*place, w, i, j, k)
        self._is_seen = False

    def put(self, body: int, frame: Pose, velocity: Point = REST, spin: Point = REST) -> None:
        """See `Engine`; a fixed body has no velocity."""
        self._place(body, frame)
        (model, data), number = self._now(), self._id[body, BASE]
        if self._bodies[body].is_fixed:
            return
        turn, at = rotation(frame[1]), model.jnt_dofadr[model.body_jntadr[number]]
        data.qvel[at : at + 3] = velocity - np.cross(spin, turn @ model.body_ipos[number])
        data.qvel[at + 3 : at + 6] = turn.T @ np.array(spin)

    def put_centre(self, body: int, pose: Pose, *, keeps_velocity: bool = False) -> None:
        """See `Engine`."""
        frame = self.geometry.compose(pose, self.geometry.inverse(self.inertial((body, BASE))))
        (self._place if keeps_velocity else self.put)(body, frame)

    # --- contacts, rays, images -----------------------------------------------------------

    def update_shapes(self) -> None:
        """See `Engine`; these contacts have no forces."""
        mujoco.mj_collision(*self._looked())
        self._contacts = self._shapes.contacts(has_forces=False)

    def contacts(
        self, body: int = ANY_BODY, link: int = ANY_LINK, *, are_pressed: bool = False
    ) -> list[Contact]:
        """See `Engine`."""
        self._now()
        if self._contacts is None:
            self._contacts = self._shapes.contacts(has_forces=True)
        found = [row for row in self._contacts if row.force > 0.0 or not are_pressed]
        if body == ANY_BODY:
            return found
        first = (_with_first(contact, body, link) for contact in found)
        return [contact for contact in first if contact is not None]

    def closest(self, link: Link, within: float) -> list[Contact]:
        """See `Engine`."""
        self._looked()
        return self._shapes.closest(link, within)

    def box(self, link: Link) -> tuple[Point, Point]:
        """See `Engine`."""
        centre = self.motion(link).centre
        return self._shapes.box(link) or (centre, centre)

    def cast(self, starts: Array, ends: Array) -> Array:
        """See `Engine`."""
        self._looked()
        return self._shapes.cast(starts, ends)

    def renderer(self) -> str:
        """See `Engine`."""
        return self._paint().renderer

    def image(
        self, size: tuple[int, int], view: Array, projection: Array, light: Light
    ) -> tuple[NDArray[np.uint8], Array]:
        """See `Engine`."""
        self._looked()
        return self._paint(*size).image(size, view, projection, light)

    def _paint(self, width: int = 640, height: int = 480) -> Painter:
        painter = self._painter
        if painter is None or width > painter.width or height > painter.height:
            self.close()
            self._painter = painter = Painter(*self._now(), width, height)
        return painter


def _with_first(contact: Contact, body: int, link: int) -> Contact | None:
    """Return a contact of a body, or of its link, as that link has it; None: it has no part."""

    def has(touching: Link) -> bool:
        return touching[0] == body and link in (ANY_LINK, touching[1])

    if has(contact.one):
        return contact
    if not has(contact.other):
        return None
    x, y, z = contact.normal
    return contact._replace(
        one=contact.other,
        other=contact.one,
        on_one=contact.on_other,
        on_other=contact.on_one,
        normal=(-x, -y, -z),
    )
