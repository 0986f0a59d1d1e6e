"""A compiled model and its state: substeps, joints, poses."""

import logging
from collections.abc import Sequence
from typing import Any

import msgspec
import mujoco
import numpy as np
from numpy.typing import NDArray

from stepbus_plant.engine import BASE, Contact, Link, Motion
from stepbus_plant.engines.mujoco.model import Body, mixed
from stepbus_plant.engines.mujoco.motors import Motors
from stepbus_plant.engines.mujoco.space import Space
from stepbus_plant.geometry import Array, Pose, rotation
from stepbus_schemas import Point

# By default MuJoCo writes them into a file in the current folder.
mujoco.set_mju_user_warning(logging.getLogger("stepbus_plant").warning)

_SLIDES = int(mujoco.mjtConstraintState.mjCNSTRSTATE_CONE)
_ROUNDS = 3


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

    def encode(self) -> bytes:
        """Return the bytes."""
        return msgspec.msgpack.encode(self)

    @classmethod
    def decode(cls, data: bytes) -> "_State":
        """Return the state of bytes."""
        return msgspec.msgpack.decode(data, type=cls)


class World:
    """A compiled model, its state, and what we keep beside it."""

    def __init__(self, model: Any, data: Any, bodies: Sequence[Body], dt: float) -> None:
        self.model, self.data = model, data
        self._bodies = list(bodies)
        self._id = {
            (body.number, n): model.body(body.body_name(n)).id
            for body in bodies
            for n in range(BASE, len(body.infos))
        }
        self._joint = {
            (body.number, n): model.joint(f"{body.number}/{n}").id
            for body in bodies
            for n, info in enumerate(body.infos)
            if info.type != "fixed"
        }
        known = {name: value for body in bodies for name, value in body.frictions.items()}
        frictions = [known.get(model.geom(n).name, (1.0, 0.0, 0.0)) for n in range(model.ngeom)]
        self._friction = np.array(frictions).reshape(-1, 3)
        self.space = Space(model, data, {number: link for link, number in self._id.items()})
        self.motors = Motors(model, dt)
        self._drift: dict[int, tuple[Array, Array]] = {}
        self.reactions: dict[Link, tuple[Array, Array]] = {}
        self._contacts: list[Contact] | None = None
        self._is_seen = False
        self._dofs: dict[tuple[int, tuple[int, ...]], NDArray[np.int64]] = {}

    def follow(self, before: "World | None") -> None:
        """Go on as the world did before its model was compiled anew; None: this is the first."""
        if before is not None:
            self.motors.take(before.motors)
            self._drift, self.reactions = before._drift, before.reactions
        for body in self._bodies[0 if before is None else len(before._bodies) :]:
            self.place(body.number, body.root)

    # --- the substep ----------------------------------------------------------------------

    def step(self) -> None:
        """Advance by one substep."""
        model, data = self.model, self.data
        self._contacts, self._is_seen = None, False
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_factorM(model, data)
        mujoco.mj_collision(model, data)
        self._mix_friction()
        self.motors.set_limits(data)
        mujoco.mj_makeConstraint(model, data)
        mujoco.mj_transmission(model, data)
        mujoco.mj_fwdVelocity(model, data)
        self.motors.aim(data)
        self._push_along()
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        mujoco.mj_fwdConstraint(model, data)
        self._let_slide()
        self.motors.feel(data)
        if self.reactions:
            self._feel()
        mujoco.mj_Euler(model, data)
        data.qfrc_applied[:] = 0.0

    def _mix_friction(self) -> None:
        """Give each contact the product of both frictions; MuJoCo takes the larger one."""
        if self.data.ncon:
            geoms = self.data.contact.geom
            self.data.contact.friction[:] = mixed(
                self._friction[geoms[:, 0]], self._friction[geoms[:, 1]]
            )

    def _push_along(self) -> None:
        """Let contacts with standing bodies that are moved know their velocity."""
        data = self.data
        if not (self._drift and data.ncon):
            return
        bodies = self.model.body_rootid[self.model.geom_bodyid[data.contact.geom]]
        for n in np.flatnonzero(np.isin(bodies, list(self._drift)).any(axis=1)):
            contact = data.contact[int(n)]
            if contact.efc_address < 0:
                continue
            for side, sign in ((0, 1.0), (1, -1.0)):
                body = int(bodies[n, side])
                if body in self._drift:
                    velocity, spin = self._drift[body]
                    moved = velocity + np.cross(spin, contact.pos - data.xpos[body])
                    along = contact.frame.reshape(3, 3) @ moved
                    rows = slice(contact.efc_address, contact.efc_address + min(contact.dim, 3))
                    damping = data.efc_KBIP.reshape(-1, 4)[rows, 1]
                    data.efc_aref[rows] += sign * damping * along[: len(damping)]

    def _let_slide(self) -> None:
        """Keep what slides on what it slides on.

        MuJoCo's convex cone lifts a sliding contact at a rate of friction times speed: it would
        rattle. Less of that is asked for, by as much as it lifts, until it does not.
        """
        model, data = self.model, self.data
        if not (data.ncon and data.nefc):
            return
        first = data.contact.efc_address
        keep = (first >= 0) & (data.efc_state[first] == _SLIDES)
        if not keep.any():
            return
        rows, friction = first[keep], data.contact.friction[keep, 0]
        wanted, acceleration = data.efc_aref[rows].copy(), np.empty(data.nefc)
        for _ in range(_ROUNDS):
            mujoco.mj_mulJacVec(model, data, acceleration, data.qacc)
            along = acceleration - data.efc_aref
            data.efc_aref[rows] = wanted - friction * np.hypot(along[rows + 1], along[rows + 2])
            mujoco.mj_fwdConstraint(model, data)

    def _feel(self) -> None:
        """Keep the reactions of watched joints, as they are before the bodies move."""
        model, data = self.model, self.data
        mujoco.mj_rnePostConstraint(model, data)
        for link in self.reactions:
            body = self._id[link]
            torque, force = data.cfrc_int[body, :3], data.cfrc_int[body, 3:]
            about = data.subtree_com[model.body_rootid[body]]
            moved = torque + np.cross(about - data.xipos[body], force)
            inertial = self._bodies[link[0]].inertials[link[1]]
            turn = data.xmat[body].reshape(3, 3) @ _matrix(inertial)
            self.reactions[link] = turn.T @ force, turn.T @ moved

    # --- state ----------------------------------------------------------------------------

    def save(self) -> bytes:
        """Return everything that the next substep, or a reading before it, depends on."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        physics = np.empty(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, physics, kind)
        return _State(
            physics=physics.tolist(),
            motors=self.motors.save(),
            drift={n: (v.tolist(), w.tolist()) for n, (v, w) in self._drift.items()},
            reactions=[(link, f.tolist(), t.tolist()) for link, (f, t) in self.reactions.items()],
            contacts=self.contacts(),
        ).encode()

    def restore(self, data: bytes) -> None:
        """Take what `save` returned."""
        saved = _State.decode(data)
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        mujoco.mj_setState(self.model, self.data, np.array(saved.physics), kind)
        self.motors.restore(saved.motors)
        self._drift = {n: (np.array(v), np.array(w)) for n, (v, w) in saved.drift.items()}
        self.reactions = {link: (np.array(f), np.array(t)) for link, f, t in saved.reactions}
        self._contacts, self._is_seen = saved.contacts, False

    # --- joints ---------------------------------------------------------------------------

    def dofs(self, body: int, indices: Sequence[int]) -> NDArray[np.int64]:
        """Return the degrees of freedom of joints."""
        key = body, tuple(indices)
        if key not in self._dofs:
            joints = [self._joint[body, index] for index in indices]
            self._dofs[key] = self.model.jnt_dofadr[joints].astype(np.int64)
        return self._dofs[key]

    def read(self, body: int, indices: Sequence[int]) -> Any:
        """Return (position, velocity, nothing, torque of the motor) of joints."""
        dofs = self.dofs(body, indices)
        places = self.motors.places[dofs]
        torques = self.motors.torques[dofs].tolist()
        rows = zip(
            self.data.qpos[places].tolist(), self.data.qvel[dofs].tolist(), torques, strict=True
        )
        return [(position, velocity, None, torque) for position, velocity, torque in rows]

    def put_joint(self, body: int, index: int, position: float, velocity: float) -> None:
        """Set position and velocity of a joint."""
        dof = self.dofs(body, [index])[0]
        self.data.qpos[self.motors.places[dof]] = position
        self.data.qvel[dof] = velocity
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

    def frame(self, link: Link) -> Pose:
        """Return the pose of a link's frame."""
        data = self.looked().data
        number = self._id[link]
        x, y, z = data.xpos[number].tolist()
        w, i, j, k = data.xquat[number].tolist()
        if link[1] == BASE and any(shift := self._bodies[link[0]].shift):
            x, y, z = (data.xpos[number] - data.xmat[number].reshape(3, 3) @ shift).tolist()
        return (x, y, z), (i, j, k, w)

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
        (x, y, z), (i, j, k, w) = frame
        data, number = self.data, self._id[body, BASE]
        if self._bodies[body].is_fixed:
            mocap = self.model.body_mocapid[number]
            data.mocap_pos[mocap], data.mocap_quat[mocap] = (x, y, z), (w, i, j, k)
        else:
            at = self.model.jnt_qposadr[self.model.body_jntadr[number]]
            data.qpos[at : at + 3] = np.array(frame[0]) + _matrix(frame) @ self._bodies[body].shift
            data.qpos[at + 3 : at + 7] = (w, i, j, k)
        self._is_seen = False

    def put(self, body: int, frame: Pose, velocity: Point, spin: Point) -> None:
        """Put the root of a body somewhere; velocity: of the centre of its mass."""
        self.place(body, frame)
        number = self._id[body, BASE]
        turn = _matrix(frame)
        linear, angular = np.array(velocity, dtype=float), np.array(spin, dtype=float)
        if self._bodies[body].is_fixed:
            linear -= np.cross(spin, turn @ self._bodies[body].inertials[BASE][0])
            self._drift.pop(number, None)
            if linear.any() or angular.any():
                self._drift[number] = linear, angular
            return
        at = self.model.jnt_dofadr[self.model.body_jntadr[number]]
        self.data.qvel[at : at + 3], self.data.qvel[at + 3 : at + 6] = linear, turn.T @ angular

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


def _matrix(pose: Pose) -> Array:
    return rotation(pose[1])


def _point(values: Array) -> Point:
    x, y, z = values.tolist()
    return x, y, z
