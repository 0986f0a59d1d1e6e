"""A compiled model and its state: substeps, joints, poses."""

import logging
from collections.abc import Sequence
from typing import Any

import msgspec
import mujoco
import numpy as np
from numpy.typing import NDArray

from stepbus_plant.engine import BASE, Contact, Link, Motion
from stepbus_plant.engines.mujoco.model import Body
from stepbus_plant.engines.mujoco.motors import Motors, motor_of
from stepbus_plant.engines.mujoco.space import Space
from stepbus_plant.geometry import Array, Pose, rotation
from stepbus_schemas import Point

# By default MuJoCo writes them into a file in the current folder.
mujoco.set_mju_user_warning(logging.getLogger("stepbus_plant").warning)

_INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION
_RESTS = np.zeros(3), np.zeros(3)
_Numbers = NDArray[np.int64]


class _State(msgspec.Struct, forbid_unknown_fields=True):
    """All that the next substep, or a reading before it, depends on.

    physics: MuJoCo's own, of mjSTATE_INTEGRATION. motors: rows of `Motors.save`. drift: velocities
    of standing bodies that are moved [m/s, rad/s]. reactions: force [N] and torque [N·m] of joints.
    """

    physics: list[float]
    motors: list[list[float]]
    drift: dict[int, tuple[list[float], list[float]]]
    reactions: list[tuple[Link, list[float], list[float]]]
    contacts: list[Contact]


class World:
    """A compiled model, its state, and what we keep beside it."""

    def __init__(self, model: Any, data: Any, bodies: Sequence[Body], dt: float) -> None:
        self.model, self.data = model, data
        self._bodies = list(bodies)
        self._id = {
            (body.number, n): model.body(body.body_name(n)).id
            for body in bodies
            for n in range(BASE, len(body.rows) - 1)
        }
        # A link with several joints has more than one number, of which contacts have the last.
        self.space = Space(model, data, {number: link for link, number in self._id.items()})
        self.motors = Motors(model, dt)
        self.reactions: dict[Link, tuple[Array, Array]] = {}
        self._drift: dict[int, tuple[Array, Array]] = {}
        self._contacts: list[Contact] | None = None
        self._is_seen = False
        self._numbers: dict[tuple[int, tuple[int, ...]], tuple[_Numbers, _Numbers, _Numbers]] = {}

    def follow(self, before: "World | None") -> None:
        """Go on as the world did before its model was compiled anew; None: this is the first."""
        if before is not None:
            self.motors.take(before.motors)
            self.reactions = before.reactions
            self._drift_with(before._drift)
        for body in self._bodies[0 if before is None else len(before._bodies) :]:
            self.place(body.number, body.root)

    def step(self) -> None:
        """Advance by one substep."""
        self._contacts, self._is_seen = None, False
        self.motors.step(self.data)
        if self.reactions:
            self._feel()
        self.data.qfrc_applied[:] = 0.0

    def _feel(self) -> None:
        """Keep the reactions of watched joints, as they were before the bodies moved."""
        data = self.data
        mujoco.mj_rnePostConstraint(self.model, data)
        for link in self.reactions:
            body = self._id[link]
            torque, force = data.cfrc_int[body, :3], data.cfrc_int[body, 3:]
            about = data.subtree_com[self.model.body_rootid[body]]
            moved = torque + np.cross(about - data.xipos[body], force)
            turn = data.xmat[body].reshape(3, 3)
            self.reactions[link] = turn.T @ force, turn.T @ moved

    # --- state ----------------------------------------------------------------------------

    def save(self) -> bytes:
        """Return everything that the next substep, or a reading before it, depends on."""
        physics = np.empty(mujoco.mj_stateSize(self.model, _INTEGRATION))
        mujoco.mj_getState(self.model, self.data, physics, _INTEGRATION)
        return msgspec.msgpack.encode(
            _State(
                physics=physics.tolist(),
                motors=self.motors.save(),
                drift={n: (v.tolist(), w.tolist()) for n, (v, w) in self._drift.items()},
                reactions=[(at, f.tolist(), t.tolist()) for at, (f, t) in self.reactions.items()],
                contacts=self.contacts(),
            )
        )

    def restore(self, data: bytes) -> None:
        """Take what `save` returned."""
        saved = msgspec.msgpack.decode(data, type=_State)
        mujoco.mj_setState(self.model, self.data, np.array(saved.physics), _INTEGRATION)
        self.motors.restore(saved.motors)
        self.reactions = {link: (np.array(f), np.array(t)) for link, f, t in saved.reactions}
        self._contacts, self._is_seen = saved.contacts, False
        self._drift_with({n: (np.array(v), np.array(w)) for n, (v, w) in saved.drift.items()})

    # --- joints ---------------------------------------------------------------------------

    def numbers(self, body: int, indices: Sequence[int]) -> tuple[_Numbers, _Numbers, _Numbers]:
        """Return where joints have their position, and their velocity, and their motors."""
        key = body, tuple(indices)
        if key not in self._numbers:
            names = [self._bodies[body].joint_name(index) for index in indices]
            joints = [self.model.joint(name) for name in names]
            found = (
                [joint.qposadr[0] for joint in joints],
                [joint.dofadr[0] for joint in joints],
                [self.model.tendon(motor_of(name)).id for name in names],
            )
            places, dofs, motors = (np.array(row, dtype=np.int64) for row in found)
            self._numbers[key] = places, dofs, motors
        return self._numbers[key]

    def read(self, body: int, indices: Sequence[int]) -> Any:
        """Return (position, velocity, nothing, torque of the motor) of joints."""
        places, dofs, motors = self.numbers(body, indices)
        positions, velocities = self.data.qpos[places].tolist(), self.data.qvel[dofs].tolist()
        nothing = [None] * len(positions)
        return list(zip(positions, velocities, nothing, self.motors.torques(motors), strict=True))

    def put_joint(self, body: int, index: int, position: float, velocity: float) -> None:
        """Set position and velocity of a joint."""
        places, dofs, _ = self.numbers(body, [index])
        self.data.qpos[places], self.data.qvel[dofs] = position, velocity
        self._is_seen = False

    def watch(self, joint: Link) -> None:
        """Measure the reaction of a joint from now on."""
        self.reactions.setdefault(joint, (np.zeros(3), np.zeros(3)))

    # --- poses ----------------------------------------------------------------------------

    def looked(self) -> "World":
        """Return itself, with all poses and velocities as they are now."""
        if not self._is_seen:
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_comPos(self.model, self.data)
            mujoco.mj_comVel(self.model, self.data)
            self._is_seen = True
        return self

    def mass(self, link: Link) -> float:
        """Return the mass of a link [kg]."""
        return float(self.model.body_mass[self._id[link]])

    def inertial(self, link: Link) -> Pose:
        """Return the centre of mass of a link in its frame, and no turn."""
        return _point(self.model.body_ipos[self._id[link]]), (0.0, 0.0, 0.0, 1.0)

    def frame(self, link: Link) -> Pose:
        """Return the pose of a link's frame."""
        data, number = self.looked().data, self._id[link]
        return _pose(data.xpos[number], data.xquat[number])

    def motion(self, link: Link) -> Motion:
        """Return pose and velocity of a link."""
        frame, body = self.frame(link), self._id[link]
        found = np.empty(6)
        kind = mujoco.mjtObj.mjOBJ_BODY
        mujoco.mj_objectVelocity(self.model, self.data, kind, body, found, 0)
        root = int(self.model.body_rootid[body])
        if root in self._drift:
            velocity, spin = self._drift[root]
            found[3:] += velocity + np.cross(spin, self.data.xipos[body] - self.data.xpos[root])
            found[:3] += spin
        return Motion(frame, _point(self.data.xipos[body]), _point(found[3:]), _point(found[:3]))

    def place(self, body: int, frame: Pose) -> None:
        """Put the root of a body somewhere, and leave its velocity."""
        place, (i, j, k, w) = frame
        data, number = self.data, self._id[body, BASE]
        if self._bodies[body].is_fixed:
            mocap = self.model.body_mocapid[number]
            data.mocap_pos[mocap], data.mocap_quat[mocap] = place, (w, i, j, k)
        else:
            at = self.model.jnt_qposadr[self.model.body_jntadr[number]]
            data.qpos[at : at + 7] = (*place, w, i, j, k)
        self._is_seen = False

    def put(self, body: int, frame: Pose, velocity: Point, spin: Point) -> None:
        """Put the root of a body somewhere; velocity: of the centre of its mass."""
        self.place(body, frame)
        number = self._id[body, BASE]
        turn, angular = rotation(frame[1]), np.array(spin, dtype=float)
        linear = np.subtract(velocity, np.cross(spin, turn @ self.model.body_ipos[number]))
        if not self._bodies[body].is_fixed:
            at = self.model.jnt_dofadr[self.model.body_jntadr[number]]
            self.data.qvel[at : at + 3], self.data.qvel[at + 3 : at + 6] = linear, turn.T @ angular
        elif linear.any() or angular.any() or number in self._drift:
            self._drift_with({**self._drift, number: (linear, angular)})

    def _drift_with(self, drift: dict[int, tuple[Array, Array]]) -> None:
        """Let the surfaces of standing bodies move, and so what is on them; drift: see `_State`."""
        model, data, stopped = self.model, self.looked().data, dict.fromkeys(self._drift, _RESTS)
        self._drift = drift
        for number, (velocity, spin) in {**stopped, **drift}.items():
            model.flg_surfacevel = True
            stands = (model.body_rootid == number) & (model.body_treeid < 0)
            for geom in np.flatnonzero(stands[model.geom_bodyid]):
                turn = data.geom_xmat[geom].reshape(3, 3)
                moved = velocity + np.cross(spin, data.geom_xpos[geom] - data.xpos[number])
                model.geom_surfacevel[geom] = *(turn.T @ moved), *(turn.T @ spin)

    # --- contacts -------------------------------------------------------------------------

    def find_contacts(self) -> None:
        """Find contacts, without forces, as everything is now."""
        self.looked()
        mujoco.mj_collision(self.model, self.data)
        self._contacts = self.space.contacts(has_forces=False)

    def contacts(self) -> list[Contact]:
        """Return the contacts that were found last."""
        if self._contacts is None:
            self._contacts = self.space.contacts(has_forces=True)
        return self._contacts


def _pose(place: Array, turn: Array) -> Pose:
    w, i, j, k = turn.tolist()
    return _point(place), (i, j, k, w)


def _point(values: Array) -> Point:
    x, y, z = values.tolist()
    return x, y, z
