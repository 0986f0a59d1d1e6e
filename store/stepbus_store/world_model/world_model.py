"""Poses of the items: from the planogram until they are seen or carried."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from stepbus_kinematics import JointOrder, RobotModel, Vector
from stepbus_participant import Config, Ports, Step, installed_version, suggest
from stepbus_schemas import (
    BaseState,
    Description,
    Detections,
    GripperState,
    JointState,
    Message,
    Point,
    Poses,
    Quaternion,
    WiringError,
)
from stepbus_store.memory import Remembering
from stepbus_store.poses import yaw_of
from stepbus_store.world_model.localization import Localization
from stepbus_store.world_model.params import Params

_UPRIGHT = 0.1
"""Parts x and y of a quaternion below which an item stands; one that lies stays in its place."""


_Row = tuple[Point, Quaternion]


@dataclass(frozen=True, kw_only=True)
class ItemPose:
    """Where an item is: position [m] and yaw [rad] of its link on the map."""

    x: float
    y: float
    z: float
    yaw: float

    def frame(self) -> pin.SE3:
        """Return the pose as a transform."""
        return pin.SE3(pin.utils.rotate("z", self.yaw), np.array([self.x, self.y, self.z]))

    @cached_property
    def row(self) -> _Row:
        """Return position and quaternion x, y, z, w."""
        return _row(self.frame())


class Items:
    """All items that the planogram lists.

    types: name → type. places: name → where it is, at first as in the planogram. same: farther from
    where it is expected, a detection is another item [m].
    """

    def __init__(self, types: Mapping[str, str], places: dict[str, ItemPose], same: float) -> None:
        self._types, self.places, self._same = types, places, same
        self.held = ""
        """The item that the gripper must be holding; empty: none."""
        self._in_tip = pin.SE3.Identity()

    def see(self, item_type: str, x: float, y: float, yaw: float) -> None:
        """Correct where an item is by a detection of its type on the map [m, rad]."""
        rows = [
            (math.hypot(place.x - x, place.y - y), name)
            for name, place in self.places.items()
            if self._types[name] == item_type
        ]
        away, name = min(rows, default=(math.inf, ""))
        if away < self._same and name != self.held:
            self.places[name] = replace(self.places[name], x=x, y=y, yaw=yaw)

    def carry(self, tip: pin.SE3, *, holding: bool) -> None:
        """Move what the gripper holds along with its tip; no message says which item that is."""
        if holding and not self.held:
            self.held = self._at(tip.translation)
            if self.held:
                self._in_tip = tip.inverse() * self.places[self.held].frame()
        if self.held:
            pose = tip * self._in_tip
            x, y, z = pose.translation.tolist()
            yaw = math.atan2(pose.rotation[1, 0], pose.rotation[0, 0])
            self.places[self.held] = ItemPose(x=x, y=y, z=z, yaw=yaw)
        if not holding:
            self.held = ""

    def _at(self, tip: Vector) -> str:
        rows = [
            (math.dist((place.x, place.y, place.z), tip), name)
            for name, place in self.places.items()
            if math.hypot(place.x - tip[0], place.y - tip[1]) < self._same
        ]
        return min(rows, default=(math.inf, ""))[1]


class _PortNames:
    def __init__(self, ports: Ports) -> None:
        ports.outputs_are("BaseState/1", "Poses/1")
        self.planogram = ports.input_of("Poses/1")
        self.odometry = ports.input_of("BaseState/1")
        self.joint_state = ports.input_of("JointState/1")
        self.gripper = ports.input_of("GripperState/1")
        self.detections = ports.input_of("Detections/1")
        self.pose = ports.output_of("BaseState/1")
        self.poses = ports.output_of("Poses/1")


class WorldModel(Remembering):
    """Publishes the pose of the base on the map, and the estimated poses of all links on the map.

    Inputs: Poses/1, the planogram, once; BaseState/1, odometry; JointState/1, GripperState/1; and
    Detections/1, with `delay: 1`. Outputs: one BaseState/1, the pose of the base on the map with
    the velocities of odometry, at every step; one Poses/1 of the links of the planogram, once per
    period. The poses of the robot's links follow from its joints, those of fixed links from the
    map, and those of items from the planogram, the latest detection or the gripper that holds them.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        ports = Ports(config)
        self._ports = _PortNames(ports)
        params = self._params = config.read(Params, ports.problems)
        problems, links = config.problems().below(("params",)), (params.frame, params.tip)
        joints = (*params.joints, *params.fingers)
        robot = problems.attempt(("model",), lambda: RobotModel(params.model, joints, links=links))
        if robot is None:
            raise problems.error()
        self._robot = robot
        self._every = max(1, round(params.period_ns / (config.every * config.step_ns)))
        self._items: Items | None = None

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Read which links the planogram lists.

        Raises WiringError for joints that are not sensed, and for a planogram without the robot.
        """
        ports, described = self._ports, inputs[self._ports.planogram]
        prefix = self._params.prefix
        joints = [prefix + joint for joint in self._params.joints]
        self._order = JointOrder(ports.joint_state, inputs[ports.joint_state].names, joints)
        self._names, frame = list(described.names), prefix + self._params.frame
        bodies = described.details.get("body", [])
        if frame not in self._names or len(bodies) != len(self._names):
            raise WiringError(
                f"input {ports.planogram!r} has no link {frame!r} with a body"
                f"{suggest(frame, self._names)}"
            )
        own = bodies[self._names.index(frame)]
        rows = enumerate(zip(self._names, bodies, strict=True))
        self._own = {n: name.removeprefix(prefix) for n, (name, body) in rows if body == own}
        lacking = [name for name in self._own.values() if name not in self._robot.links]
        if lacking:
            raise WiringError(f"links {', '.join(lacking)} are not in {self._params.model}")
        types = described.details.get("type", [""] * len(self._names))
        self._types = {n: t for n, t in zip(self._names, types, strict=True) if t}
        self.remember()

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the pose of the base, and the poses of all links when they are due."""
        items = self._items or self._unfold(step.read(self._ports.planogram, Poses))
        detections = step.get(self._ports.detections, Detections)
        if detections is not None and step.is_new(self._ports.detections):
            # They are of the step before: the base has not been moved on yet.
            self._see(items, detections)
        odometry = step.read(self._ports.odometry, BaseState)
        self._localization.predict(odometry)
        x, y, yaw = self._localization.pose
        pose = BaseState(x=x, y=y, yaw=yaw, vx=odometry.vx, wz=odometry.wz)
        messages: dict[str, Message] = {self._ports.pose: pose}
        gripper = step.read(self._ports.gripper, GripperState)
        joints = step.read(self._ports.joint_state, JointState)
        arm = self._order.pick(joints.position, "position")
        q = np.array([*arm, *(gripper.width / 2 for _ in self._params.fingers)])
        base = self._base()
        items.carry(base * self._robot.frame_pose(q, self._params.tip), holding=gripper.holding)
        if (step.index // self.config.every) % self._every == 0:
            messages[self._ports.poses] = self._poses(items, base, q)
        return messages

    def _unfold(self, planogram: Poses) -> Items:
        """Read the map: landmarks, items, and what is fixed."""
        params = self._params
        self._known = list(zip(planogram.position, planogram.orientation, strict=True))
        known = dict(zip(self._names, self._known, strict=True))
        marks = [at[:2] for name, (at, _) in known.items() if name.startswith(params.landmark)]
        start = _place(*known[params.prefix + params.frame])
        self._height = start.z
        self._localization = Localization(
            np.array(marks).reshape(-1, 2), params, (start.x, start.y, start.yaw)
        )
        places = {name: _place(*row) for name, row in known.items() if name in self._types}
        self._items = Items(self._types, places, params.same)
        return self._items

    def _base(self) -> pin.SE3:
        x, y, yaw = self._localization.pose
        return pin.SE3(pin.utils.rotate("z", yaw), np.array([x, y, self._height]))

    def _see(self, items: Items, detections: Detections) -> None:
        rows = list(zip(detections.types, detections.position, detections.orientation, strict=True))
        mark = self._params.landmark
        self._localization.correct([at[:2] for name, at, _ in rows if name == mark])
        base, (_, _, yaw) = self._base(), self._localization.pose
        for name, at, turn in rows:
            if name != mark and abs(turn[0]) + abs(turn[1]) < _UPRIGHT:
                x, y, _ = base.act(np.array(at)).tolist()
                items.see(name, x, y, yaw + yaw_of(turn))

    def _poses(self, items: Items, base: pin.SE3, q: np.ndarray) -> Poses:
        rows, own = list(self._known), self._robot.frame_poses(q, tuple(self._own.values()))
        for n, pose in zip(self._own, own, strict=True):
            rows[n] = _row(base * pose)
        for n, name in enumerate(self._names):
            if name in self._types:
                rows[n] = items.places[name].row
        return Poses(position=[at for at, _ in rows], orientation=[turn for _, turn in rows])

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the result."""
        return {name: installed_version(name) for name in ("numpy", "pin")}


def _place(at: Point, turn: Quaternion) -> ItemPose:
    return ItemPose(x=at[0], y=at[1], z=at[2], yaw=yaw_of(turn))


def _row(pose: pin.SE3) -> _Row:
    """Return a pose as position and quaternion x, y, z, w."""
    x, y, z = pose.translation.tolist()
    a, b, c, w = pin.Quaternion(pose.rotation).coeffs().tolist()
    return (x, y, z), (a, b, c, w)
