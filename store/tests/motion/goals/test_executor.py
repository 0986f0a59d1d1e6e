"""Goals: one at a time, each with the story of its states and the cause of its end."""

import pytest
from support.services.arm import JOINTS, Runner, write_arm

from stepbus_kinematics import RobotModel
from stepbus_schemas import Goal


@pytest.fixture
def robot(tmp_path):
    return RobotModel(write_arm(tmp_path), JOINTS)


def joints(number, *values, **fields):
    return Goal(id=number, type="move_joints", joints=list(JOINTS), values=list(values), **fields)


def states(runner):
    return [(status.id, status.state) for status in runner.statuses()]


def test_a_goal_is_accepted_then_running_then_succeeds(robot):
    runner = Runner(robot)
    runner.start(joints(1, 1.0, -1.0, 0.5), 0.0)
    runner.carry_on(0.0)
    assert states(runner) == [(1, "accepted"), (1, "running"), (1, "succeeded")]
    assert runner.at(9.0).position == pytest.approx([1.0, -1.0, 0.5])


def test_a_motion_that_ruckig_has_no_words_for_is_refused(robot):
    runner = Runner(robot)
    runner.start(joints(1, 0.6, 0.6, 0.6, duration=86400.0), 0.0)
    assert [(n.state, n.cause) for n in runner.statuses()] == [("failed", "no_path")]


def test_a_goal_that_is_refused_stops_the_one_before(robot):
    runner = Runner(robot)
    runner.start(joints(1, 2.0, 2.0, 2.0), 0.0)
    runner.start(joints(2, 9.0, 0.0, 0.0), 0.5)
    runner.carry_on(0.5)
    assert states(runner) == [(1, "accepted"), (1, "cancelled"), (2, "failed")]
    assert runner.at(9.0).position.max() < 1.9


def test_a_new_goal_cancels_the_old_one_without_a_jump(robot):
    runner = Runner(robot)
    runner.start(joints(1, 2.0, 2.0, 2.0), 0.0)
    before = runner.at(0.5)
    runner.start(joints(2, -1.0, 0.0, 0.0), 0.5)
    assert (1, "cancelled") in states(runner)
    assert runner.at(0.5).position == pytest.approx(before.position)
    assert runner.at(0.5).velocity == pytest.approx(before.velocity)


def test_motors_that_do_not_follow_fail_the_goal_with_joint_and_error(robot):
    runner = Runner(robot)
    runner.start(joints(1, 0.5, 0.5, 1.5), 0.0)
    runner.carry_on(0.0, stuck=True)
    last = runner.statuses()[-1]
    assert (last.state, last.cause) == ("failed", "not_settled")
    assert "three is 57.296° off" in last.text
    assert runner.at(9.0).position == pytest.approx([0.5, 0.5, 0.5])


def test_a_pose_that_cannot_be_held_is_refused_or_tried_as_one_likes(tmp_path):
    robot = RobotModel(write_arm(tmp_path, effort=30.0), JOINTS)
    out = joints(1, 0.0, 0.3, 0.3)
    refuses, tries = Runner(robot), Runner(robot, tries_unholdable=True)
    for runner in (refuses, tries):
        runner.start(out, 0.0)
    assert [(n.state, n.cause) for n in refuses.statuses()] == [("failed", "not_holdable")]
    assert [(n.state, n.cause) for n in tries.statuses()] == [("accepted", "not_holdable")]
