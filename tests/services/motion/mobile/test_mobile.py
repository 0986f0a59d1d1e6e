"""The controller of a mobile manipulator, closed by motors that follow perfectly."""

import math
import re
from types import MappingProxyType

import numpy as np
import pinocchio as pin
import pytest
from support.services.control import Stand

from stepbus_motion.ik import analytic
from stepbus_motion.mobile.participant import MobileController
from stepbus_participant import Config
from stepbus_schemas import (
    BaseState,
    Contacts,
    Description,
    Goal,
    GripperState,
    InputConfig,
    JointState,
    OutputConfig,
    Plan,
    RunError,
    WiringError,
)
from stepbus_schemas.messages import Spiral

MS = 1_000_000
DT = 0.008
JOINTS = ("pan", "lift", "elbow", "roll", "pitch", "turn")
READY = (0.0, -1.2, 1.9, 0.0, 0.9, 0.0)
INPUTS = MappingProxyType(
    {
        "joint_state": "JointState/1", "odometry": "BaseState/1", "gripper": "GripperState/1",
        "contacts": "Contacts/1", "goal": "Goal/1",
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


def without_eaik(warnings):
    """Return warnings without that of an installation without the extra `robots`."""
    return [text for text in warnings if "eaik" not in text]


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
    return Config(
        name="controller", step_ns=8 * MS, every=1, seed=0, folder=folder,
        inputs={name: InputConfig(source="x", port=name, type=port) for name, port in inputs.items() if name not in leave_out},
        outputs={name: OutputConfig(type=port) for name, port in outputs.items() if name not in leave_out},
        params={"model": "robot.urdf", "joints": list(JOINTS), **params},
    )  # fmt: skip


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
        arm, load = self.stand.participant.settings.robot, self.mass if self.holds() else 0.0
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
        arm = self.stand.participant.settings.robot
        return arm.frame_pose(self.q, frame)


@pytest.fixture
def robot(tmp_path):
    return Robot(config(tmp_path))


def test_it_holds_everything_where_it_is_until_there_is_a_goal(robot):
    robot.run(0.2)
    assert robot.q == pytest.approx(READY)
    out = robot.commands[-1]
    assert (out["base"].vx, out["base"].wz, out["gripper"].width) == (0.0, 0.0, 0.1)
    assert robot.news == []


def test_nothing_is_commanded_before_everything_is_measured(tmp_path):
    stand = Robot(config(tmp_path)).stand
    assert stand.update(0, odometry=BaseState(x=0, y=0, yaw=0, vx=0, wz=0)) == {}


def test_a_goal_of_the_arm_is_accepted_runs_and_succeeds(robot):
    end = robot.go(0, "move_joints", joints=["pan"], values=[0.8])
    assert robot.states(0) == ["accepted", "running", "succeeded"], end.text
    assert robot.q[0] == pytest.approx(0.8, abs=1e-3)


def test_a_tip_goes_to_a_pose_in_the_frame_of_odometry_from_wherever_the_base_is(robot):
    assert robot.go(0, "drive", by=0.3).state == "succeeded"
    assert robot.go(1, "turn", by=0.2).state == "succeeded"
    turn = pin.Quaternion(pin.rpy.rpyToMatrix(0.1, 1.2, 0.3)).coeffs()
    end = robot.go(2, "move_to_pose", tip="grasp", frame="odometry", position=(0.8, 0.1, 0.6),
                   orientation=tuple(turn.tolist()))  # fmt: skip
    assert end.state == "succeeded", end.text
    base = pin.SE3(pin.rpy.rpyToMatrix(0, 0, robot.yaw), np.array([robot.x, robot.y, 0]))
    assert (base * robot.place("grasp")).translation == pytest.approx([0.8, 0.1, 0.6], abs=1e-3)


def test_base_and_hand_are_served_too(robot):
    assert robot.go(0, "go_to", base=(-0.5, 0.0, 0.0)).state == "succeeded"
    assert robot.x == pytest.approx(-0.5, abs=2e-3)
    robot.thing = 0.066
    assert "held: 66.0 mm" in robot.go(1, "grip", width=0.0, force=15.0).text


def test_a_new_goal_cancels_the_one_before_and_stops_its_part(robot):
    robot.start(0, "drive", by=1.0)
    robot.run(1.0)
    assert robot.vx > 0.2
    assert robot.go(1, "move_joints", joints=["pan"], values=[0.5]).state == "succeeded"
    assert robot.states(0)[-1] == "cancelled"
    robot.run(1.0)
    assert abs(robot.vx) < 1e-3
    assert robot.states(0)[-1] == "cancelled"


def test_a_stop_brings_arm_and_base_to_rest_and_keeps_what_is_held(robot):
    robot.thing = 0.066
    robot.go(0, "grip", width=0.0, force=15.0)
    robot.start(1, "move_joints", joints=["pan"], values=[2.0])
    robot.run(0.8)
    assert abs(robot.v[0]) > 0.2
    end = robot.go(2, "stop")
    assert (end.state, end.text) == ("succeeded", "all is at rest")
    assert robot.states(1)[-1] == "cancelled"
    assert np.abs(robot.v).max() < 1e-9
    assert robot.width == pytest.approx(0.066)


@pytest.mark.parametrize("goal_type", ["drive", "turn", "go_to"])
def test_the_base_does_not_move_while_the_hand_is_too_high(tmp_path, goal_type):
    robot = Robot(config(tmp_path, safe_height=0.6), q=(0.0, -1.5, 1.0, 0.0, 0.0, 0.0))
    end = robot.go(0, goal_type, by=0.5, base=(1.0, 0.0, 0.0))
    assert (end.state, end.cause) == ("failed", "too_high")
    assert "grasp is 1.287 m above the floor; the base moves only below 0.6 m" in end.text
    assert (robot.x, robot.yaw) == (0.0, 0.0)


def test_the_base_does_not_move_while_the_hand_reaches_too_far_out(tmp_path):
    robot = Robot(config(tmp_path, safe_reach=0.5), q=(0.0, 0.0, 0.2, 0.0, 0.0, 0.0))
    assert robot.go(0, "drive", by=0.5).cause == "too_far"


def test_a_jammed_base_fails_and_stands(robot):
    robot.jammed = True
    end = robot.go(0, "drive", by=1.0)
    assert end.cause == "jammed"
    assert "the left wheel rolls at 0.00 m/s instead of" in end.text
    assert robot.step()["base"].vx == 0.0


def test_the_arm_stops_backs_off_and_fails_when_it_touches_what_it_must_not(robot):
    robot.start(0, "move_joints", joints=["pan"], values=[2.0])
    robot.run(0.5)
    robot.touching = [("hand", "pillar", 0.0, 0.005)]
    robot.run(0.8)
    touched = robot.place("grasp").translation.copy()
    robot.touching = [("hand", "pillar", 7.5, -0.001)]
    robot.step()
    robot.touching = []
    robot.run(3.0)
    end = robot.news[-1]
    assert (end.state, end.cause) == ("failed", "collision")
    assert "hand touches pillar with 7.5 N; stopped, backed off 50 mm" in end.text
    assert robot.q[0] < 2.0
    assert np.abs(robot.v).max() < 1e-9
    assert np.linalg.norm(robot.place("grasp").translation - touched) < 0.12


def test_the_base_backs_off_five_centimetres(robot):
    robot.start(0, "drive", by=1.0)
    robot.run(1.5)
    robot.touching = [("chassis", "crate", 30.0, 0.0)]
    robot.step()
    robot.touching = []
    furthest = max(self_x for self_x in _xs(robot, 4.0))
    assert robot.news[-1].cause == "collision"
    assert furthest - robot.x == pytest.approx(0.05, abs=5e-3)
    went = f"chassis touches crate with 30.0 N; stopped, backed off {1e3 * (furthest - robot.x):.0f} mm"
    assert robot.news[-1].text == f"{went} by odometry, nothing is near it"


def test_a_base_that_cannot_get_away_says_so(robot):
    robot.start(0, "drive", by=1.0)
    robot.run(1.5)
    robot.touching = [("chassis", "crate", 30.0, 0.0)]
    robot.step()
    robot.touching = [("chassis", "crate", 45.0, 0.0)]
    robot.jammed = True
    robot.run(8.0)
    text = "chassis touches crate with 45.0 N; stopped, backed off 0 mm by odometry"
    assert robot.news[-1].text == f"{text}, still touches it with 45.0 N"
    assert robot.commands[-1]["base"].vx == 0.0


def test_backing_off_stops_before_what_comes_close_behind(robot):
    robot.start(0, "drive", by=1.0)
    robot.run(1.5)
    robot.touching = [("chassis", "crate", 30.0, 0.0)]
    robot.step()
    stood = robot.x
    for _ in range(500):
        behind = 0.01 - max(stood - robot.x, 0.0)
        robot.touching = [("chassis", "crate", 0.0, 0.01), ("chassis", "post", 0.0, behind)]
        robot.step()
    assert 3e-3 < behind < 5e-3
    assert "mm from post behind it, now 10.0 mm from it" in robot.news[-1].text


def test_the_base_stops_before_it_touches_what_it_comes_close_to(robot):
    robot.start(0, "drive", by=2.0)
    robot.run(1.0)
    post = robot.x + 0.4
    while robot.news[-1].state not in ("failed", "succeeded"):
        if post - robot.x < 0.08:
            robot.touching = [("chassis", "post", 0.0, post - robot.x)]
        robot.step()
    assert (robot.news[-1].state, robot.news[-1].cause) == ("failed", "blocked")
    gap = 1e3 * (post - robot.x)
    assert 3.0 < gap < 5.0
    assert robot.news[-1].text == f"chassis is {gap:.1f} mm from post; stopped before it touches"
    assert robot.step()["base"].vx == 0.0


def test_what_is_close_but_comes_no_closer_does_not_stop_the_base(robot):
    robot.touching = [("chassis", "post", 0.0, 0.004)]
    assert robot.go(0, "drive", by=0.1).state == "succeeded"


def _xs(robot, seconds):
    for _ in range(round(seconds / DT)):
        robot.step()
        yield robot.x


def test_after_a_collision_the_next_goal_may_leave_what_is_still_touched(robot):
    robot.start(0, "move_joints", joints=["pan"], values=[1.0])
    robot.run(0.8)
    robot.touching = [("hand", "pillar", 7.5, -0.001)]
    robot.run(3.0)
    assert robot.news[-1].cause == "collision"
    assert robot.go(1, "move_joints", joints=["pan"], values=[0.0]).state == "succeeded"


def test_motion_is_slower_near_an_obstacle_and_says_so(tmp_path):
    times = []
    for touching in ([], [("hand", "pillar", 0.0, 0.006)]):
        robot = Robot(config(tmp_path))
        robot.step()
        robot.touching = touching
        robot.go(0, "move_joints", joints=["pan"], values=[1.0])
        times.append(robot.k * DT)
    assert times[1] > 1.8 * times[0]
    assert without_eaik(robot.warnings) == ["hand is 6 mm from pillar: slower"]


def test_an_arm_is_not_slowed_down_by_what_stands_near_the_base(robot):
    robot.touching = [("chassis", "pillar", 0.0, 0.02)]
    robot.go(0, "move_joints", joints=["pan"], values=[1.0])
    assert without_eaik(robot.warnings) == []


def test_what_slips_out_during_a_goal_fails_it(robot):
    robot.thing = 0.066
    robot.go(0, "grip", width=0.0, force=15.0)
    robot.start(1, "move_joints", joints=["pan"], values=[2.0])
    robot.run(0.4)
    robot.thing = None
    robot.run(2.0)
    end = robot.news[-1]
    assert (end.id, end.state, end.cause) == (1, "failed", "slipped")
    assert np.abs(robot.v).max() < 1e-9


def test_with_a_planner_the_arm_moves_by_its_plan(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    robot.start(0, "move_joints", joints=["pan"], values=[0.3], touches=["can"])
    request = robot.requests[0]
    assert (request.start, request.touches) == (pytest.approx(READY), ["can"])
    robot.step(plan=answered(request))
    robot.run(2.0)
    assert robot.states(0) == ["accepted", "running", "succeeded"]
    assert robot.q[0] == pytest.approx(0.3, abs=1e-3)


def test_what_is_held_is_weighed_and_the_planner_hears_of_it(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    robot.thing, robot.mass = 0.066, 0.8
    robot.go(0, "grip", width=0.0, force=30.0)
    robot.run(1.0)
    robot.start(1, "move_joints", joints=["pan"], values=[0.3])
    assert robot.requests[0].load == pytest.approx(0.8, abs=0.02)
    # 1.5 times what a friction of 0.4 needs.
    assert robot.commands[-1]["gripper"].force == pytest.approx(14.7, abs=0.4)
    robot.go(2, "grip", width=0.09, force=30.0)
    robot.start(3, "move_joints", joints=["pan"], values=[0.3])
    assert robot.requests[-1].load == 0.0


def test_a_plan_that_is_none_fails_the_goal_with_its_cause(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    robot.start(0, "move_joints", joints=["pan"], values=[0.3])
    robot.step(plan=Plan(id=robot.requests[0].id, cause="no_path", text="all paths are blocked"))
    robot.run(0.1)
    assert (robot.news[-1].cause, robot.news[-1].text) == ("no_path", "all paths are blocked")


def answered(request):
    """Return a plan that goes straight to what is asked for in a second."""
    times = np.linspace(0.0, 1.0, 51)
    share = 10 * times**3 - 15 * times**4 + 6 * times**5
    speed = 30 * times**2 - 60 * times**3 + 30 * times**4
    way = np.array(request.goal) - np.array(request.start)
    return Plan(
        id=request.id, times=times.tolist(),
        position=(np.array(request.start) + np.outer(share, way)).tolist(),
        velocity=np.outer(speed, way).tolist(),
    )  # fmt: skip


@pytest.fixture
def planned(tmp_path):
    """Return a robot on the way that a planner has found, 0.4 s after its start."""
    robot = Robot(config(tmp_path, plans=True))
    robot.start(0, "move_joints", joints=["pan"], values=[0.8])
    robot.step(plan=answered(robot.requests[0]))
    robot.run(0.4)
    assert abs(robot.v[0]) > 0.5
    return robot


def finish(robot):
    """Answer the second request, and return the states of the goal until it has ended."""
    robot.run(0.5)
    assert np.abs(robot.v).max() < 1e-9
    assert robot.requests[1].start == pytest.approx(robot.q, abs=1e-6)
    assert robot.requests[1].goal == robot.requests[0].goal
    robot.step(plan=answered(robot.requests[1]))
    robot.run(9.0)
    return robot.states(0)


def test_when_its_way_is_blocked_the_arm_stops_and_goes_on_by_another_one(planned):
    robot = planned
    robot.step(plan=Plan(id=robot.requests[0].id, cause="blocked", text="crate is in the way"))
    robot.step()
    assert robot.news[-1].text == "crate is in the way; stopped, asked for another path (1 of 3)"
    assert finish(robot) == ["accepted", "running", "running", "succeeded"]
    assert robot.q[0] == pytest.approx(0.8, abs=1e-3)


def test_what_comes_too_close_on_a_planned_way_is_gone_around(planned):
    robot = planned
    robot.touching = [("hand", "crate", 0.0, 0.003)]
    robot.step()
    assert robot.news[-1].text.startswith("hand is 3.0 mm from crate; stopped, asked for another")
    assert finish(robot)[-1] == "succeeded"
    assert len(robot.requests) == 2


def test_its_own_links_are_as_close_as_the_planner_has_checked_but_others_behind_them_count(
    planned,
):
    robot = planned
    robot.touching = [("hand", "upper", 0.0, 0.002)]
    robot.run(0.2)
    assert len(robot.requests) == 1
    robot.touching += [("crate", "hand", 0.0, 0.003)]
    robot.step()
    assert robot.news[-1].text.startswith("hand is 3.0 mm from crate; stopped, asked for another")


def test_what_is_touched_on_a_planned_way_is_left_first_and_then_gone_around(planned):
    robot = planned
    robot.touching = [("hand", "crate", 7.5, -0.001)]
    robot.step()
    touched = robot.place("grasp").translation.copy()
    robot.touching = []
    while len(robot.requests) < 2:
        robot.step()
    assert np.linalg.norm(robot.place("grasp").translation - touched) > 0.02
    assert "hand touches crate with 7.5 N; stopped, backed off 50 mm; " in robot.news[-1].text
    assert finish(robot)[-1] == "succeeded"


def test_a_goal_is_given_other_ways_so_many_times_and_no_more(tmp_path):
    robot = Robot(config(tmp_path, plans=True, replans=1))
    robot.start(0, "move_joints", joints=["pan"], values=[0.8])
    for number in range(2):
        robot.step(plan=answered(robot.requests[-1]))
        robot.run(0.3)
        robot.step(plan=Plan(id=robot.requests[-1].id, cause="blocked", text="a cat"))
        robot.run(0.5)
        assert len(robot.requests) == 2, number
    end = robot.news[-1]
    assert (end.state, end.cause, end.text) == (
        "failed",
        "no_path",
        "a cat; stopped, after 1 other path",
    )
    assert np.abs(robot.v).max() < 1e-9


def test_when_the_planner_has_failed_everything_stops_and_nothing_begins_again(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    robot.start(0, "drive", by=1.0)
    robot.run(1.0)
    robot.step(plan=Plan(id=0, cause="planner_failed", text="the planner has failed"))
    assert (robot.news[-1].state, robot.news[-1].cause) == ("failed", "no_plan")
    robot.run(2.0)
    assert abs(robot.vx) < 1e-3
    assert robot.go(1, "drive", by=-1.0).text == "the planner has failed"
    assert robot.go(2, "stop").state == "succeeded"


def test_two_runs_are_equal_to_the_byte(tmp_path):
    shown = []
    for _ in range(2):
        robot = Robot(config(tmp_path))
        robot.go(0, "go_to", base=(0.2, 0.1, 0.5))
        robot.go(1, "move_joints", joints=["pan", "elbow"], values=[0.4, 1.5])
        shown.append(robot.commands)
    assert shown[0] == shown[1]


def test_all_mistakes_of_a_scenario_are_listed_at_once(tmp_path):
    with pytest.raises(WiringError) as caught:
        MobileController(
            config(tmp_path, plans=True, leave_out=("plan", "gripper"), pads=["left_pad"],
                   base_speed=0, arm_creep=-2, base_sped=1)
        )  # fmt: skip
    text = str(caught.value)
    for part in ("none is of type GripperState/1", "none is of type GripperCommand/1",
                 "base_speed: must be above 0, not 0", "arm_creep: must be above 0, not -2",
                 "unknown key 'base_sped'; did you mean 'base_speed'",
                 "a planner needs an input of type Plan/1"):  # fmt: skip
        assert part in text


@pytest.mark.parametrize(
    ("params", "text"),
    [
        ({"tip": "grasps"}, "tip: frame 'grasps' is not in robot.urdf; did you mean 'grasp'"),
        ({"tip": "chassis"}, "tip: no joint of this controller moves 'chassis'"),
        ({"pads": ["left_pad"]}, "pads: names 1 links"),
        ({"ignore": ["wheels"]}, "ignore: link 'wheels' is not in the model"),
        ({"arm_brake": 0}, "arm_brake: must be above 0"),
    ],
)
def test_a_parameter_that_does_not_fit_the_robot_is_refused(tmp_path, params, text):
    with pytest.raises(WiringError) as caught:
        MobileController(config(tmp_path, **params))
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("goal", "cause"),
    [
        ({"type": "drive", "by": 1e300}, "invalid"),
        ({"type": "turn", "by": 1e9}, "invalid"),
        ({"type": "go_to", "base": (0.0, -1e200, 0.0)}, "invalid"),
        ({"type": "move_to_pose", "position": (1e300, 0.0, 0.0)}, "unreachable"),
        ({"type": "move_linear", "position": (-9e3, 0.0, 0.0)}, "unreachable"),
        ({"type": "spiral", "spiral": {"turns": 1e9}}, "invalid"),
        ({"type": "spiral", "spiral": {"rise": 1e300}}, "invalid"),
    ],
)
def test_a_goal_with_absurd_numbers_fails_at_once_and_nothing_else_does(tmp_path, goal, cause):
    robot = Robot(config(tmp_path))
    robot.step()
    wanted = {
        "tip": "grasp",
        "position": (0.6, 0.0, 0.4),
        "orientation": (0.0, 0.0, 0.0, 1.0),
        **goal,
    }
    if "spiral" in goal:
        usual = {"centre": (0.6, 0.0, 0.4), "radius": (0.05, 0.1), "turns": 1.0, "rise": 0.1}
        wanted["spiral"] = Spiral(**{**usual, **goal["spiral"]})
    robot.step(goal=Goal(id=5, **wanted))
    assert [(news.state, news.cause) for news in robot.news] == [("failed", cause)]


@pytest.mark.parametrize(
    ("message", "sentence"),
    [
        (
            {"contacts": Contacts(pairs=[("hand", "x")], force=[], distance=[0.0], position=[])},
            "the contacts have 1 pairs, 0 forces, 1 distances",
        ),
        (
            {"joint_state": JointState(position=[math.nan] * 6)},
            "measurements of the joints are not finite: .*nan",
        ),
        (
            {"odometry": BaseState(x=0.0, y=math.inf, yaw=0.0, vx=0.0, wz=0.0)},
            "measurements of the base are not finite: .*inf",
        ),
        (
            {"gripper": GripperState(width=math.nan, force=0.0, holding=False)},
            "measurements of the gripper are not finite: .*nan",
        ),
    ],
)
def test_a_message_that_is_none_is_refused_in_one_sentence(tmp_path, message, sentence):
    robot = Robot(config(tmp_path))
    robot.step()
    with pytest.raises(RunError, match=sentence):
        robot.stand.update(1, **{**robot.sense(), **message})


def test_that_eaik_is_missing_is_a_warning_and_given_once(tmp_path, monkeypatch):
    monkeypatch.setattr(analytic, "HPRobot", None)
    robot = Robot(config(tmp_path))
    for _ in range(3):
        robot.step()
    (text,) = robot.warnings
    assert text.startswith("tip 'grasp': eaik is not installed, so one solution")
    assert "[robots]" in text


def test_a_duration_that_could_not_be_kept_is_reported_with_the_reason(robot):
    robot.touching = [("hand", "post", 0.0, 0.003)]
    end = robot.go(0, "move_joints", joints=["pan"], values=[0.9], duration=1.5)
    assert (end.state, end.cause) == ("succeeded", "slower")
    assert re.match(r"took \d\.\d\d s instead of 1.50 s: hand is 3 mm from post; ", end.text)


def test_a_duration_that_the_limits_do_not_allow_is_reported(robot):
    end = robot.go(0, "move_joints", joints=["pan"], values=[1.5], duration=0.5)
    assert end.cause == "slower"
    assert "s instead of 0.50 s: the joints cannot be faster within their limits" in end.text


def test_a_duration_that_was_kept_is_not_worth_a_word(robot):
    end = robot.go(0, "move_joints", joints=["pan"], values=[0.5], duration=4.0)
    assert (end.cause, "instead of" in end.text) == ("", False)


def go_and_meet_a_post(robot):
    """Drive along a planned route until a post is 5 mm ahead; return where it stood then."""
    robot.start(0, "go_to", base=(2.0, 0.0, 0.0))
    robot.step(plan=Plan(id=robot.requests[-1].id, route=[(2.0, 0.0, 0.0)]))
    robot.run(1.5)
    post = robot.x + 0.4
    while len(robot.requests) < 2 and robot.k < 2000:
        gap = post - robot.x
        robot.touching = [("chassis", "post", 0.0, gap)] if gap < 0.08 else []
        robot.step()
    return robot.x


def test_a_pose_is_gone_to_along_the_planners_route(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    robot.start(0, "go_to", base=(1.0, 0.0, 0.0), touches=["can"])
    request = robot.requests[-1]
    assert (request.base, request.touches) == (((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), ["can"])
    assert robot.x == 0.0
    robot.step(plan=Plan(id=request.id, route=[(0.5, 0.3, 0.0), (1.0, 0.0, 0.0)]))
    ys = []
    for _ in range(2000):
        robot.step()
        ys.append(robot.y)
    assert robot.news[-1].state == "succeeded"
    assert max(ys) == pytest.approx(0.3, abs=5e-3)
    assert (robot.x, robot.y) == pytest.approx((1.0, 0.0), abs=3e-3)


def test_where_there_is_no_route_the_base_stays_and_says_why(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    robot.start(0, "go_to", base=(1.0, 0.0, 0.0))
    robot.step(plan=Plan(id=robot.requests[-1].id, cause="no_path", text="a wall"))
    robot.run(0.1)
    end = robot.news[-1]
    assert (end.state, end.cause, end.text, robot.x) == ("failed", "no_path", "a wall", 0.0)


def test_before_something_on_its_route_the_base_stops_and_asks_for_another(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    stood = go_and_meet_a_post(robot)
    assert [news.state for news in robot.news] == ["accepted", "running", "running"]
    assert "stopped before it touches; asked for another route (1 of 3)" in robot.news[-1].text
    assert robot.requests[-1].base[0][0] == pytest.approx(stood, abs=1e-3)
    robot.touching = []
    robot.step(plan=Plan(id=robot.requests[-1].id, route=[(stood, 0.5, 0.0), (2.0, 0.0, 0.0)]))
    robot.run(20.0)
    assert robot.news[-1].state == "succeeded"
    assert robot.x == pytest.approx(2.0, abs=3e-3)


def test_a_stop_ends_a_route_and_what_waits_for_one(tmp_path):
    robot = Robot(config(tmp_path, plans=True))
    go_and_meet_a_post(robot)
    assert robot.go(1, "stop").state == "succeeded"
    stood = robot.x
    robot.step(plan=Plan(id=robot.requests[-1].id, route=[(2.0, 0.0, 0.0)]))
    robot.run(1.0)
    assert robot.x == pytest.approx(stood, abs=1e-3)
