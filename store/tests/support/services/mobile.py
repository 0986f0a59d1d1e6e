"""A mobile manipulator whose motors follow perfectly, with its controller."""

import math
from types import MappingProxyType

import numpy as np
from support.services.control import Stand, make_config

from stepbus_schemas import BaseState, Contacts, Description, Goal, GripperState, JointState
from stepbus_store.motion.mobile.mobile_controller import MobileController

MS = 1_000_000
DT = 0.008
JOINTS = ("pan", "lift", "elbow", "roll", "pitch", "turn")
READY = (0.0, -1.2, 1.9, 0.0, 0.9, 0.0)
INPUTS = MappingProxyType(
    {
        "joint_state": "JointState/1", "odometry": "BaseState/1", "gripper": "GripperState/1",
        "contacts": "Contacts/1", "goal": "Goal/1", "stop": "EmergencyStop/1",
    }
)  # fmt: skip
OUTPUTS = MappingProxyType(
    {
        "arm": "JointCommand/1", "base": "BaseCommand/1", "gripper": "GripperCommand/1",
        "goal_status": "GoalStatus/1", "status": "ControllerStatus/1",
    }
)  # fmt: skip
# parent, child, joint, axis, place; a chassis, an arm of six joints 0.5 m above the floor, a hand.
_ROWS = (
    ("chassis", "column", "pan", "0 0 1", "0.15 0 0.5"),
    ("column", "upper", "lift", "0 1 0", "0 0 0.1"),
    ("upper", "fore", "elbow", "0 1 0", "0.4 0 0"),
    ("fore", "wrist", "roll", "1 0 0", "0.4 0 0"),
    ("wrist", "palm", "pitch", "0 1 0", "0 0 0"),
    ("palm", "hand", "turn", "1 0 0", "0.1 0 0"),
)
_FIXED = (("chassis", "left_wheel"), ("hand", "left_pad"), ("hand", "right_pad"), ("hand", "grasp"))


def write_robot(folder):
    """Write robot.urdf."""
    body = (
        '<link name="{0}"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" '
        'ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    parts = [body.format("chassis")]
    for parent, child, name, axis, place in _ROWS:
        parts.append(
            body.format(child)
            + f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{place}"/><axis xyz="{axis}"/>'
            '<limit lower="-3.1" upper="3.1" effort="100" velocity="3"/></joint>'
        )
    for parent, child in _FIXED:
        at = "0.1 0 0" if child == "grasp" else "0.05 0 0"
        parts.append(
            f'<link name="{child}"/><joint name="{child}_mount" type="fixed"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{at}"/></joint>'
        )
    (folder / "robot.urdf").write_text(f'<robot name="robot">{"".join(parts)}</robot>')


def config(folder, *, plans=False, leave_out=(), **params):
    write_robot(folder)
    inputs = dict(INPUTS) | ({"plan": "Plan/1"} if plans else {})
    outputs = dict(OUTPUTS) | ({"plan_request": "PlanRequest/1"} if plans else {})
    ports = (
        {name: kind for name, kind in rows.items() if name not in leave_out}
        for rows in (inputs, outputs)
    )
    params = {"model": "robot.urdf", "joints": list(JOINTS), **params}
    return make_config("controller", *ports, folder, params=params, step_ns=8 * MS)


class Robot:
    """A perfect plant around the controller; touching: rows of pairs, force and distance."""

    def __init__(self, given, q=READY):
        controller = MobileController(given)
        names = Description(names=list(JOINTS), limits={"effort": [100.0] * 6})
        controller.start(dict.fromkeys(given.inputs, names))
        self.stand = Stand(controller)
        self.q, self.v = np.array(q), np.zeros(6)
        self.x, self.y, self.yaw, self.vx, self.wz = 0.0, 0.0, 0.0, 0.0, 0.0
        self.width, self.thing, self.mass = 0.1, None, 0.0
        self.touching, self.jammed = [], False
        self.k, self.news, self.warnings, self.requests, self.commands = 0, [], [], [], []

    def step(self, **more):
        """Move on by a step; more: messages on other ports."""
        out = self.stand.update(self.k, **self.sense(), **more)
        self.k += 1
        self.news += [out["goal_status"]] if "goal_status" in out else []
        self.requests += [out["plan_request"]] if "plan_request" in out else []
        self.warnings += out["status"].warnings if "status" in out else []
        self.commands.append(out)
        if "arm" not in out:
            # In an emergency stop, something else brakes.
            self.v, self.vx, self.wz = np.zeros(6), 0.0, 0.0
            return out
        self.v = np.array(out["arm"].velocity)
        self.q = np.array(out["arm"].values) + self.v * DT
        self.vx, self.wz = (0.0, 0.0) if self.jammed else (out["base"].vx, out["base"].wz)
        self.x += self.vx * DT * math.cos(self.yaw)
        self.y += self.vx * DT * math.sin(self.yaw)
        self.yaw += self.wz * DT
        gap = min(max(out["gripper"].width - self.width, -0.1 * DT), 0.1 * DT)
        self.width = max(self.width + gap, self.thing or 0.0)
        return out

    def sense(self):
        rows = sorted(self.touching)
        holding = self.holds()
        return {
            "joint_state": JointState(
                position=self.q.tolist(), velocity=self.v.tolist(), effort=self.effort()
            ),
            "odometry": BaseState(x=self.x, y=self.y, yaw=self.yaw, vx=self.vx, wz=self.wz),
            "gripper": GripperState(width=self.width, force=15.0 * holding, holding=holding),
            "contacts": Contacts(
                pairs=[row[:2] for row in rows], force=[row[2] for row in rows],
                distance=[row[3] for row in rows], position=[(0.0, 0.0, 0.0)] * len(rows),
            ),
        }  # fmt: skip

    def effort(self):
        """Return the torques of an arm at rest that carries `mass` once the thing is held."""
        arm, load = self.stand.participant.robot, self.mass if self.holds() else 0.0
        carried = arm.load
        arm.carry(load, "grasp")
        torque = arm.gravity_torque(self.q).tolist()
        arm.carry(carried, "grasp")
        return torque

    def holds(self):
        return self.thing is not None and self.width <= self.thing

    def run(self, seconds):
        for _ in range(round(seconds / DT)):
            self.step()

    def start(self, number, goal_type, **fields):
        self.step(goal=Goal(id=number, type=goal_type, **fields))

    def go(self, number, goal_type, seconds=30.0, **fields):
        """Return the status with which a goal ends."""
        self.start(number, goal_type, **fields)
        for _ in range(round(seconds / DT)):
            ended = [
                n for n in self.news if n.id == number and n.state not in ("accepted", "running")
            ]
            if ended:
                return ended[0]
            self.step()
        raise AssertionError(f"goal {number} did not end: {self.news}")

    def states(self, number):
        return [news.state for news in self.news if news.id == number]

    def place(self, frame):
        arm = self.stand.participant.robot
        return arm.frame_pose(self.q, frame)
