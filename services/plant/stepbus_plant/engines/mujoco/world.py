"""A compiled model and its state: substeps, joints, poses."""

import logging
from collections.abc import Sequence
from typing import Any

import msgspec
import mujoco
import numpy as np
from numpy.typing import NDArray

from stepbus_models.mjcf import one_line
from stepbus_plant.engine import (
    BASE,
    REST,
    Contact,
    Engine,
    Goal,
    Indices,
    Link,
    Motion,
    PhysicsError,
    Values,
)
from stepbus_plant.engines.mujoco.model import Body
from stepbus_plant.engines.mujoco.motors import Motors, motor_of
from stepbus_plant.geometry import Array, Geometry, Pose, rotation
from stepbus_schemas import Point

# By default MuJoCo writes them into a file in the current folder.
mujoco.set_mju_user_warning(logging.getLogger("stepbus_plant").warning)

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


class World(Engine):
    """The part of an `Engine` that moves bodies, once they are loaded.

    spec: of its model. dt: length of a substep [s]. The model is compiled when something first
    needs it; bodies, exceptions from collisions and gears come before.
    """

    def __init__(self, spec: Any, dt: float) -> None:
        self.geometry = Geometry()
        self._spec, self._dt = spec, dt
        self._bodies: list[Body] = []
        self._is_seen = False
        self._compiled: tuple[Any, Any] | None = None
        self._motors: Any = None
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
        return model, data

    def step(self) -> None:
        """See `Engine`."""
        model, data = self._now()
        self._contacts, self._is_seen = None, False
        self._motors.step(data)
        if self._reactions:
            self._feel(model, data)
        data.qfrc_applied[:] = 0.0

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


def point(values: Array) -> Point:
    """Return three numbers of an array."""
    x, y, z = values.tolist()
    return x, y, z
