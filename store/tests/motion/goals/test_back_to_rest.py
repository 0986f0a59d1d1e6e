"""An arm that goes back to rest: at once, or freed first, or with a sentence."""

import numpy as np
import pinocchio as pin
import pytest
from motion.goals.test_beside import answer
from support.services.mobile import DT, JOINTS, READY, Robot, config

from stepbus_schemas import Plan

REST = {"joints": list(JOINTS), "values": [0.2, *READY[1:]]}


@pytest.fixture
def robot(tmp_path):
    return Robot(config(tmp_path, plans=True))


def carry_on(robot, refused, seconds=20.0):
    """Answer what the planner is asked; refused: how many paths to other joints are."""
    seen = {request.id for request in robot.requests}
    for _ in range(round(seconds / DT)):
        robot.step()
        if robot.news and robot.news[-1].state in {"succeeded", "failed"}:
            return robot.news[-1]
        request = robot.requests[-1] if robot.requests else None
        if request is None or request.id in seen:
            continue
        seen.add(request.id)
        if request.path:
            still = {"times": [0.0, 0.016], "velocity": [[0.0] * 6] * 2}
            fields = {**still, "position": [list(request.goal)] * 2}
            robot.step(plan=Plan(id=request.id, **fields))
        elif refused:
            refused -= 1
            answer(robot, cause="start_collides", text="at the start, hand touches shelf")
        else:
            answer(robot)
    raise AssertionError(f"it goes on: {robot.news}")


def test_an_arm_goes_back_to_rest_along_a_planned_path(robot):
    robot.start(0, "back_to_rest", **REST)
    answer(robot)
    end = carry_on(robot, 0)
    assert end.state == "succeeded"
    assert end.text.startswith("back at rest; settled")
    assert robot.q == pytest.approx(REST["values"], abs=1e-3)


def test_where_an_arm_rests_may_be_a_pose(robot):
    pose = robot.place("grasp")
    x, y, z = pose.translation.tolist()
    turn = tuple(pin.Quaternion(pose.rotation).coeffs().tolist())
    goal = {"tip": "grasp", "position": (x, y, z - 0.05), "orientation": turn}
    robot.start(0, "back_to_rest", **goal)
    answer(robot)
    end = carry_on(robot, 0)
    assert end.text.startswith("back at rest; settled")
    assert robot.place("grasp").translation == pytest.approx([x, y, z - 0.05], abs=1e-3)


def test_an_arm_that_has_come_from_somewhere_goes_back_there_first(robot):
    robot.start(0, "move_joints", joints=["pan"], values=[0.5])
    answer(robot)
    robot.run(3.0)
    came = robot.place("grasp").translation.copy()
    robot.start(1, "back_to_rest", **REST)
    answer(robot, cause="start_collides", text="at the start, hand touches shelf")
    robot.run(2.0)
    assert np.linalg.norm(robot.place("grasp").translation - came) == pytest.approx(0.1, abs=0.01)
    answer(robot)
    end = carry_on(robot, 0)
    assert (end.state, "after going back; " in end.text) == ("succeeded", True)


def test_an_arm_without_a_way_back_rises_first(robot):
    height = robot.place("grasp").translation[2]
    robot.start(0, "back_to_rest", **REST)
    answer(robot, cause="start_collides", text="at the start, hand touches shelf")
    end = carry_on(robot, 0)
    assert (end.state, "after going 0.05 m up; " in end.text) == ("succeeded", True)
    model = robot.stand.participant.robot
    heights = [
        model.frame_pose(np.array(row["arm"].values), "grasp").translation[2]
        for row in robot.commands
    ]
    assert max(heights) == pytest.approx(height + 0.05, abs=2e-3)


def test_where_nothing_frees_the_arm_it_says_what_was_tried(robot):
    robot.start(0, "back_to_rest", **REST)
    answer(robot, cause="start_collides", text="at the start, hand touches shelf")
    end = carry_on(robot, 9)
    assert (end.state, end.cause) == ("failed", "no_path")
    assert end.text.startswith("no path back to rest, after going")
    assert "hand touches shelf" in end.text


def test_what_the_gripper_loses_on_the_way_back_is_reported(robot):
    robot.thing = 0.06
    robot.go(0, "grip", width=0.05, force=10.0)
    robot.start(1, "back_to_rest", **REST)
    answer(robot)
    robot.run(0.3)
    robot.thing = None
    end = carry_on(robot, 0)
    assert (end.id, end.state) == (1, "succeeded")
    assert [text for text in robot.warnings if "held" in text or "lost" in text]
