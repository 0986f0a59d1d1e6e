"""A robot's model: forward kinematics, Jacobians and torques of joints in an order you choose."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from struct import Struct
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from stepbus_models import Joint, read_robot, urdf_text
from stepbus_participant import suggest
from stepbus_schemas import RunError, WiringError

Vector = NDArray[np.float64]

Values = Vector | Sequence[float]
"""One value of each joint."""

Indices = NDArray[np.intp]
"""Which of the joints, increasing."""

STANDARD_GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True, kw_only=True)
class Overload:
    """A joint that needs more torque than its motor has, or force, in `unit`."""

    joint: str
    required: float
    available: float
    unit: str = "N·m"

    def __str__(self) -> str:
        has = f"has {self.available:.1f} {self.unit}"
        return f"{self.joint} needs {self.required:.1f} {self.unit} and {has}"


class RobotModel:
    """A robot with a fixed base. Some of its joints move; all others are locked.

    path: URDF, `.xacro` or MJCF. joints: those that move, in the order of every vector of shape
    (n,); None: all, in Pinocchio's order. posture: positions of other joints [rad or m]; joints not
    named are neutral; joints with `<mimic>` follow theirs. gravity: in the base, shape (3,) [m/s²].
    bounded: every joint needs position limits. links: which the model must have.

    lower, upper, velocity_limit, effort_limit: of the joints, shape (n,) [rad, rad/s, N·m]; of
    prismatic ones, here and everywhere, [m, m/s, N]. load: what it carries [kg].
    robot: as its file describes it. model, data: Pinocchio's, of the joints that move. full,
    stance: its model of all joints, and their positions when those that move are at neutral.
    Raises WiringError that lists every problem of the file, the joints and the links.
    """

    def __init__(
        self,
        path: Path,
        joints: Sequence[str] | None = None,
        *,
        posture: Mapping[str, float] | None = None,
        gravity: Sequence[float] = STANDARD_GRAVITY,
        bounded: bool = False,
        links: Sequence[str] = (),
    ) -> None:
        self.path = path
        self.robot = read_robot(path)
        self.text = urdf_text(self.robot, for_pinocchio=True)
        try:
            self.full: Any = pin.buildModelFromXML(self.text)
        except ValueError as exc:
            raise WiringError(f"{path} is not a URDF that Pinocchio can read") from exc
        for name in self._movable():
            number = self.full.getJointId(name)
            self.full.armature[self.full.idx_vs[number]] = self.robot.joints[name].armature
        self._mimics = {j.name: j.mimic for j in self.robot.joints.values() if j.mimic}
        movable = [name for name in self._movable() if name not in self._mimics]
        self.joints = tuple(movable if joints is None else joints)
        problems = list(self._problems(posture or {}, links, bounded=bounded))
        if problems:
            raise WiringError("\n".join(problems))
        self.stance: Vector = self._posture(posture or {})
        self.model: Any = self._reduced()
        self.model.gravity.linear = np.array(gravity, dtype=np.float64)
        self.data: Any = self.model.createData()
        self._numbers: dict[str, int] = {}
        self.load = 0.0
        self._unloaded: tuple[int, Any] | None = None
        self._index_joints()
        if self.robot.format == "mjcf":
            self._add_passive()

    def _movable(self) -> tuple[str, ...]:
        """Return the names of all joints that move, in Pinocchio's order."""
        return tuple(self.full.names)[1:]

    def _problems(
        self, posture: Mapping[str, float], links: Sequence[str], *, bounded: bool
    ) -> Iterator[str]:
        """Yield a sentence for each joint and link that is not as wanted."""
        file, others = self.path.name, tuple(posture)
        for joint in self.robot.joints.values():
            if joint.type == "ball":
                text = "which controllers do not support; use three hinges"
                yield f"joint {joint.name!r} of {file} is a ball joint, {text}"
        yield from self._joint_problems(self.joints, bounded=bounded)
        yield from self._joint_problems(others, bounded=True)
        yield from (
            f"joint {name!r} is also in 'joints'; remove one of them"
            for name in others
            if name in self.joints
        )
        for name in (*self.joints, *others):
            if name in self._mimics:
                leader = self._mimics[name].joint
                yield f"joint {name!r} of {file} follows {leader!r}; name that joint instead"
        known = link_names(self.full)
        for name in links:
            if name not in known:
                yield f"link {name!r} is not in {file}{suggest(name, known)}"
        if not self.joints:
            yield f"{self.path} has no movable joint"

    def _joint_problems(self, joints: Sequence[str], *, bounded: bool) -> Iterator[str]:
        """Yield a sentence for each joint that is missing or lacks limits."""
        file, movable = self.path.name, self._movable()
        for name in joints:
            if name not in movable:
                yield f"joint {name!r} is not in {file}{suggest(name, movable)}"
            elif bounded and not self._is_bounded(self.robot.joints[name]):
                yield f"joint {name!r} of {file} has no position limits"

    @staticmethod
    def _is_bounded(joint: Joint) -> bool:
        return joint.lower is not None and joint.upper is not None and joint.lower < joint.upper

    def _posture(self, positions: Mapping[str, float]) -> Vector:
        """Return a posture of all joints, those that follow others where these take them."""
        followed = {
            name: mimic.multiplier * positions.get(mimic.joint, 0.0) + mimic.offset
            for name, mimic in self._mimics.items()
        }
        q: Vector = pin.neutral(self.full)
        for name, value in {**positions, **followed}.items():
            q[self.full.idx_qs[self.full.getJointId(name)]] = value
        return q

    def locked(self) -> list[int]:
        """Return the Pinocchio numbers of the joints that stand still."""
        moving = {name for name, mimic in self._mimics.items() if mimic.joint in self.joints}
        moving |= set(self.joints)
        return [self.full.getJointId(name) for name in self._movable() if name not in moving]

    def _reduced(self) -> Any:
        locked = self.locked()
        if not locked:
            return self.full.copy()
        try:
            return pin.buildReducedModel(self.full, locked, self.stance)
        except ValueError as exc:
            raise WiringError(f"{self.path}: {exc}; has a joint the name of a link?") from exc

    def _index_joints(self) -> None:
        model, ids = self.model, [self.model.getJointId(name) for name in self.joints]
        self._index = np.array([model.idx_vs[i] for i in ids], dtype=np.intp)
        self._index_followers()
        self._is_direct = self._index.tolist() == list(range(model.nv))
        self._packed: Any = np.zeros((3, model.nv))
        self._vectors = tuple(self._packed)
        self._pack = Struct(f"{self._packed.size}d").pack_into
        joints = [self.robot.joints[name] for name in self.joints]
        self.lower: Vector = _known([joint.lower for joint in joints], -np.inf)
        self.upper: Vector = _known([joint.upper for joint in joints], np.inf)
        self.velocity_limit: Vector = _known([joint.velocity for joint in joints], np.inf)
        self.effort_limit: Vector = _known([joint.effort for joint in joints], np.inf)

    def _index_followers(self) -> None:
        """Find where the joints that follow one of `joints` are in Pinocchio's vectors."""
        model = self.model
        rows = [
            (model.getJointId(name), self.joints.index(mimic.joint), mimic)
            for name, mimic in self._mimics.items()
            if mimic.joint in self.joints
        ]
        self._followed = np.array([leader for _, leader, _ in rows], dtype=np.intp)
        self._gear: Vector = np.array([mimic.multiplier for _, _, mimic in rows], dtype=float)
        self._offset: Vector = np.array([mimic.offset for _, _, mimic in rows], dtype=float)
        self._followers = np.array([model.idx_vs[number] for number, _, _ in rows], dtype=np.intp)

    def _add_passive(self) -> None:
        """Add springs and dampers of the joints, and what carries links, of an MJCF."""
        joints = [self.robot.joints[name] for name in list(self.model.names)[1:]]
        self._stiffness: Vector = np.array([joint.stiffness for joint in joints])
        self._damping: Vector = np.array([joint.damping for joint in joints])
        self._spring_rest: Vector = np.array([joint.spring_rest for joint in joints])
        # A model of the masses that the simulation carries.
        self._carried: Any = self.model.copy()
        for number in range(self.model.njoints):
            self._carried.inertias[number] = pin.Inertia.Zero()
        for frame in self.model.frames:
            link = self.robot.links.get(frame.name)
            if frame.type == pin.FrameType.BODY and link is not None and link.inertial is not None:
                mass = link.inertial.mass * link.gravity_compensation
                _add_mass(self._carried, frame, mass, link.inertial.pose.xyz)
        self._carried_data: Any = self._carried.createData()

    def _passive(self, q: Vector) -> Vector:
        """Return what springs and gravity compensation ask of the motors, shape (nv,) [N·m]."""
        torque: Vector = self._stiffness * (q - self._spring_rest)
        torque -= pin.computeGeneralizedGravity(self._carried, self._carried_data, q)
        return torque

    def unit(self, joint: str) -> str:
        """Return the unit of a joint's position: m of a prismatic one, else rad."""
        return "m" if self._is_prismatic(joint) else "rad"

    def effort_unit(self, joint: str) -> str:
        """Return the unit of a joint's effort: N of a prismatic one, else N·m."""
        return "N" if self._is_prismatic(joint) else "N·m"

    def _is_prismatic(self, joint: str) -> bool:
        return self.robot.joints[joint].type == "prismatic"

    @cached_property
    def links(self) -> tuple[str, ...]:
        """The names of all links."""
        return link_names(self.model)

    def in_model(self, q: Values) -> Vector:
        """Return positions, shape (n,) [rad], as Pinocchio's model wants them, shape (nq,)."""
        return self._spread(q, self._offset)

    def _spread(self, values: Values, offset: Vector | float = 0.0) -> Vector:
        """Return values of the joints, shape (n,), in Pinocchio's order, shape (nv,).

        offset: of the followers' values, shape (followers,).
        """
        values = np.array(values)
        if self._is_direct:
            return values
        out = np.zeros(self.model.nv)
        out[self._index] = values
        out[self._followers] = self._gear * values[self._followed] + offset
        return out

    def _of_joints(self, values: Vector) -> Vector:
        """Return what Pinocchio has for each degree of freedom, last axis, for the joints.

        That of a follower adds to its joint's, by the gear between them.
        """
        if self._is_direct:
            return values
        row: Vector = values[..., self._index]
        for leader, gear, at in zip(self._followed, self._gear, self._followers, strict=True):
            row[..., leader] += gear * values[..., at]
        return row

    def frame_id(self, name: str) -> int:
        """Return Pinocchio's number of a link, or of another frame where no link has that name.

        Raises RunError for a name that the model lacks.
        """
        if name not in self._numbers:
            model, link = self.model, pin.FrameType.BODY
            if not model.existFrame(name):
                known = [frame.name for frame in model.frames]
                raise RunError(f"frame {name!r} is not in {self.path.name}{suggest(name, known)}")
            sort = (link,) if model.existFrame(name, link) else ()
            self._numbers[name] = model.getFrameId(name, *sort)
        return self._numbers[name]

    def frame_pose(self, q: Vector, frame: str) -> Any:
        """Return the pose of a frame in the robot's base, as a `pinocchio.SE3`.

        q: shape (n,) [rad]. An empty name is the base itself. Raises RunError for an unknown frame.
        """
        if not frame:
            return pin.SE3.Identity()
        return self.frame_poses(q, [frame])[0]

    def frame_poses(self, q: Vector, frames: Sequence[str]) -> list[Any]:
        """Return the poses of several frames, see `frame_pose`."""
        numbers = [self.frame_id(frame) for frame in frames]
        pin.framesForwardKinematics(self.model, self.data, self.in_model(q))
        return [self.data.oMf[number].copy() for number in numbers]

    def chain(self, tip: str) -> Indices:
        """Return which of the joints move a frame."""
        frame = self.model.frames[self.frame_id(tip)]
        above = {self.model.names[i] for i in self.model.supports[frame.parentJoint]}
        return np.array([i for i, name in enumerate(self.joints) if name in above], dtype=np.intp)

    def jacobian(self, q: Vector, number: int) -> tuple[Any, Vector]:
        """Return pose and Jacobian of a frame, shape (6, n), in the axes of the base [m/rad, -].

        q: shape (n,) [rad]. number: of the frame, see `frame_id`.
        """
        # computeFrameJacobian would do both in one, but it leaves the placements as they were.
        pin.computeJointJacobians(self.model, self.data, self.in_model(q))
        pin.updateFramePlacement(self.model, self.data, number)
        return self.data.oMf[number], self._frame_jacobian(self.data, number)

    def _frame_jacobian(self, data: Any, number: int) -> Vector:
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return self._of_joints(pin.getFrameJacobian(self.model, data, number, axes))

    @cached_property
    def _aside(self) -> Any:
        """Pinocchio's data for what has to outlast calls of other methods."""
        return self.model.createData()

    def twists(self, q: Vector, v: Vector) -> Callable[[str], Vector]:
        """Return a function: frame → its twist, shape (6,), in the axes of the base [m/s, rad/s].

        q, v: shape (n,) [rad, rad/s]. What all frames share is computed once. The function holds
        until the next call of this method, and raises RunError for an unknown frame.
        """
        data = self._aside
        pin.computeJointJacobians(self.model, data, self.in_model(q))

        def twist(frame: str) -> Vector:
            number = self.frame_id(frame)
            pin.updateFramePlacement(self.model, data, number)
            return self._frame_jacobian(data, number) @ v

        return twist

    def inverse_dynamics(self, q: Values, v: Values, a: Values) -> Vector:
        """Return the torques M(q) a + C(q, v) v + g(q), shape (n,) [N·m].

        q, v, a: shape (n,) [rad, rad/s, rad/s²]. Armatures and dampers of an MJCF count, damping
        of a URDF and friction do not; g: as of `gravity_torque`. By the recursive Newton-Euler
        algorithm (Featherstone, Rigid Body Dynamics Algorithms, 2008, table 5.1).
        """
        is_direct = self._is_direct and isinstance(q, list)
        if is_direct and len(q) == len(v) == len(a) == len(self.joints):
            # Of lists, much quicker than three arrays.
            self._pack(self._packed, 0, *q, *v, *a)
            there, rate, gain = self._vectors
        else:
            there, rate, gain = self._spread(q, self._offset), self._spread(v), self._spread(a)
        torque = pin.rnea(self.model, self.data, there, rate, gain)
        if self.robot.format == "mjcf":
            torque = torque + self._passive(there) + self._damping * rate
        return self._of_joints(torque)

    def carry(self, mass: float, frame: str) -> None:
        """Count a mass at the origin of a frame in all torques from now on, instead of the last.

        mass: [kg]; 0: nothing is carried. Raises RunError for an unknown frame.
        """
        number = self.frame_id(frame)
        self.load = max(mass, 0.0)
        if self._unloaded is not None:
            joint, inertia = self._unloaded
            self.model.inertias[joint] = inertia
            self._unloaded = None
        if mass > 0.0:
            place = self.model.frames[number]
            unloaded = self.model.inertias[place.parentJoint].copy()
            _add_mass(self.model, place, mass)
            self._unloaded = (place.parentJoint, unloaded)

    def gravity_torque(self, q: Values) -> Vector:
        """Return the torques g(q) that hold the robot at rest, shape (n,) [N·m].

        q: shape (n,) [rad]. Springs and gravity compensation of an MJCF count.
        """
        there = self.in_model(q)
        torque = pin.computeGeneralizedGravity(self.model, self.data, there)
        if self.robot.format == "mjcf":
            torque = torque + self._passive(there)
        return self._of_joints(torque)

    def overload(
        self, q: Vector, among: Indices | None = None, share: float = 1.0
    ) -> Overload | None:
        """Return the joint whose motor is furthest from holding the robot at rest at q.

        Returns None where all can hold it. among: joints that are checked; None: all. share: of
        the effort limits that may be used.
        """
        checked = np.arange(len(self.joints)) if among is None else among
        required = np.abs(self.gravity_torque(q))[checked]
        available = (self.effort_limit * share)[checked]
        worst = int(np.argmax(required - available))
        if required[worst] <= available[worst]:
            return None
        return Overload(
            joint=self.joints[checked[worst]],
            required=float(required[worst]),
            available=float(available[worst]),
            unit=self.effort_unit(self.joints[checked[worst]]),
        )


def link_names(model: Any) -> tuple[str, ...]:
    """Return the names of all links of Pinocchio's model, in its order."""
    return tuple(frame.name for frame in model.frames if frame.type == pin.FrameType.BODY)


def _add_mass(model: Any, frame: Any, mass: float, at: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
    """Add a mass [kg] to Pinocchio's model; at: where in a frame, shape (3,) [m]."""
    load = pin.Inertia(mass, frame.placement.act(np.array(at)), np.zeros((3, 3)))
    model.inertias[frame.parentJoint] = model.inertias[frame.parentJoint].copy() + load


def _known(values: Sequence[float | None], unlimited: float) -> Vector:
    """Return limits of joints, with a number for those without one."""
    return np.array([unlimited if value is None else value for value in values])
