"""The controller of a mobile manipulator: goals, their ends, and what is refused."""

import math

import numpy as np
import pytest
from support.services.mobile import READY, Robot, config

from stepbus_schemas import (
    BaseState,
    EmergencyStop,
    Goal,
    GripperState,
    JointState,
    RunError,
    WiringError,
)
from stepbus_schemas.messages import Spiral
from stepbus_store.motion.mobile.mobile_controller import MobileController


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


def test_all_mistakes_of_a_scenario_are_listed_at_once(tmp_path):
    with pytest.raises(WiringError) as caught:
        MobileController(
            config(tmp_path, plans=True, leave_out=("plan", "gripper"), pads=["left_pad"],
                   base_speed=0, arm_creep=-2, base_sped=1)
        )  # fmt: skip
    text = str(caught.value)
    for part in ("no port has type GripperState/1", "no port has type GripperCommand/1",
                 "base_speed: must be a number above 0, not 0", "arm_creep: must be a number above 0, not -2",
                 "unknown key 'base_sped'; did you mean 'base_speed'",
                 "a planner needs an input of type Plan/1"):  # fmt: skip
        assert part in text


@pytest.mark.parametrize(
    ("params", "text"),
    [
        ({"tip": "grasps"}, "tip: link 'grasps' is not in the model; did you mean 'grasp'"),
        ({"tip": "chassis"}, "tip: no joint of this controller moves 'chassis'"),
        ({"pads": ["left_pad"]}, "pads: names 1 links"),
        ({"ignore": ["wheels"]}, "ignore: link 'wheels' is not in the model"),
        ({"arm_brake": 0}, "arm_brake: must be a number above 0"),
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


def test_a_duration_that_the_limits_do_not_allow_is_reported(robot):
    end = robot.go(0, "move_joints", joints=["pan"], values=[1.5], duration=0.5)
    assert (end.state, end.cause) == ("succeeded", "slower")
    assert "s instead of 0.50 s; " in end.text


def test_a_duration_that_was_kept_is_not_worth_a_word(robot):
    end = robot.go(0, "move_joints", joints=["pan"], values=[0.5], duration=4.0)
    assert (end.cause, "instead of" in end.text) == ("", False)


def stopped(active, since=0.0):
    return EmergencyStop(active=active, by="a guard", since=since)


@pytest.mark.parametrize(
    ("kind", "fields"),
    [
        ("move_joints", {"joints": ["pan"], "values": [0.8]}),
        ("go_to", {"base": (-0.5, 0.0, 0.0)}),
        ("grip", {"width": 0.0, "force": 15.0}),
    ],
)
def test_an_emergency_stop_fails_the_goal_and_nothing_is_commanded(robot, kind, fields):
    robot.start(0, kind, **fields)
    robot.run(0.3)
    robot.step(stop=stopped(active=True, since=0.3))
    robot.run(0.2)
    assert robot.states(0) == ["accepted", "running", "failed"]
    end = robot.news[-1]
    assert (end.cause, end.text) == ("emergency_stop", "emergency stop by a guard at 0.30 s")
    assert all(set(out) <= {"goal_status", "status"} for out in robot.commands[-25:])


def test_a_goal_in_an_emergency_stop_fails_at_once(robot):
    robot.run(0.1)
    robot.step(stop=stopped(active=True))
    robot.start(0, "move_joints", joints=["pan"], values=[0.8])
    robot.run(0.1)
    assert [(news.state, news.cause) for news in robot.news] == [("failed", "emergency_stop")]


def test_after_its_release_the_robot_stays_where_it_is_and_takes_goals(robot):
    robot.start(0, "move_joints", joints=["pan"], values=[0.8])
    robot.run(0.5)
    robot.step(stop=stopped(active=True))
    where = robot.q.copy()
    robot.run(0.2)
    out = robot.step(stop=stopped(active=False))
    assert out["arm"].values == pytest.approx(where.tolist(), abs=1e-9)
    assert out["arm"].velocity == [0.0] * 6
    robot.run(0.2)
    assert robot.q == pytest.approx(where, abs=1e-9)
    assert robot.go(1, "move_joints", joints=["pan"], values=[0.8]).state == "succeeded"
