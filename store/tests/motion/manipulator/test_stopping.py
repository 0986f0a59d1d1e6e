"""How an arm pauses, stops, turns to another goal, and backs off."""

import numpy as np
import pytest
from support.services.manipulator import HOME, PERIOD, Log, Stage, make_arm, make_robot, pose_goal
from support.services.ur5 import ASIDE, SPIRAL, joints_goal, refusal, tips

from stepbus_store.motion.outcome import Refused


def test_a_pause_holds_the_arm_on_its_way_within_the_acceleration_limits(robot):
    stage, log = Stage(make_arm(robot)), Log()
    stage.start(joints_goal())
    for step in range(600):
        stage.step(log, scale=0.0 if 40 <= step < 240 else 1.0)
    free = Stage(make_arm(robot)).run(joints_goal())
    assert np.array_equal(log.q[239], log.q[200])
    assert np.allclose(log.q[-1], ASIDE)
    # On the same way: each paused pose lies between two of the unpaused motion.
    gaps = [np.linalg.norm(np.array(free.q) - q, axis=1).min() for q in log.q]
    assert max(gaps) < 0.02
    assert np.abs(log.push()).max() <= 1.02 * 4.0


def test_at_half_the_scale_it_takes_twice_as_long(robot):
    def steps(scale):
        stage, log = Stage(make_arm(robot)), Log()
        stage.start(SPIRAL)
        while log.outcome is None:
            stage.step(log, scale)
        return log.steps

    assert steps(0.5) == pytest.approx(2 * steps(1.0), rel=0.02)


def test_a_stop_brakes_hard_even_while_paused(robot):
    stage, log = Stage(make_arm(robot)), Log()
    stage.start(joints_goal())
    for _ in range(40):
        stage.step(log)
    stage.arm.stop(stage.t)
    log.outcome = None
    while log.outcome is None:
        stage.step(log, scale=0.0)
    assert log.outcome.state == "succeeded"
    assert 4.5 < np.abs(log.push()).max() <= 15.0 + 1e-6
    assert log.steps < 40 + 30
    assert np.abs(np.array(log.q[-1]) - ASIDE).max() > 0.1


@pytest.mark.parametrize(("touches", "hardest"), [(False, 6.0), (True, 12.0)])
def test_what_is_held_is_not_swung_out_of_the_pads_by_a_stop_without_a_touch(touches, hardest):
    robot = make_robot()
    stage, log = Stage(make_arm(robot)), Log()
    stage.arm.carry(0.4)
    stage.start(joints_goal(np.add(ASIDE, [1.5, 0, 0, 0, 0, 0])))
    for _ in range(60):
        stage.step(log)
    stage.arm.stop(stage.t, touches=touches)
    log, before = Log(), np.linalg.norm(np.diff(tips(robot, log.q[-2:]), axis=0)) / PERIOD
    while log.outcome is None:
        stage.step(log)
    pushes = np.linalg.norm(np.diff(tips(robot, log.q), n=2, axis=0), axis=1) / PERIOD**2
    assert before > 0.8
    assert 0.5 * hardest < pushes.max() <= 1.05 * hardest


def test_a_new_goal_in_full_motion_makes_no_jump(robot):
    for goal in (joints_goal(HOME), pose_goal("move_linear", [0.4, 0.4, 0.3]), SPIRAL):
        stage, log = Stage(make_arm(robot)), Log()
        stage.start(joints_goal())
        for _ in range(40):
            stage.step(log)
        stage.start(goal)
        while log.outcome is None:
            stage.step(log)
        assert log.outcome.state == "succeeded"
        assert np.abs(log.push()).max() <= 4.0 + 1e-6


def test_a_refused_goal_in_full_motion_brings_the_arm_to_rest(robot):
    stage, log = Stage(make_arm(robot)), Log()
    stage.start(joints_goal())
    for _ in range(40):
        stage.step(log)
    refusal(stage, pose_goal("move_to_pose", [2.0, 0, 0]))
    for _ in range(100):
        stage.step(log)
    assert log.outcome is None
    assert np.array_equal(log.q[-1], log.q[-20])
    assert np.abs(log.push()).max() <= 4.0 + 1e-6


def test_backing_off_goes_back_the_same_way_by_that_distance(robot):
    stage, log = Stage(make_arm(robot)), Log()
    stage.start(pose_goal("move_linear", [0.5, 0.4, 0.35]))
    for _ in range(150):
        stage.step(log)
    length = stage.arm.back_off(stage.t, 0.05)
    back = stage.run()
    forth, way = tips(robot, log.q), tips(robot, back.q)
    turn = int(np.argmax(np.linalg.norm(way - forth[0], axis=1)))
    forth = np.concatenate([forth, way[:turn]])
    off = [np.linalg.norm(forth - place, axis=1).min() for place in way[turn:]]
    assert length == pytest.approx(0.05)
    assert back.outcome.state == "succeeded"
    assert np.linalg.norm(way[turn] - way[-1]) == pytest.approx(0.05, abs=2e-3)
    assert max(off) < 2e-3


def test_backing_off_again_goes_further_until_no_path_is_left(robot):
    stage, log = Stage(make_arm(robot)), Log()
    start = tips(robot, [HOME])[0]
    stage.start(pose_goal("move_linear", [0.5, 0.2, 0.25]))
    for _ in range(90):
        stage.step(log)
    lengths, last = [], stage.q
    while np.linalg.norm(tips(robot, [last])[0] - start) > 1e-3:
        lengths.append(stage.arm.back_off(stage.t, 0.03))
        last = stage.run().q[-1]
    assert lengths[:2] == pytest.approx([0.03, 0.03])
    assert sum(lengths) == pytest.approx(
        np.linalg.norm(tips(robot, log.q[-1:])[0] - start), abs=0.02
    )
    with pytest.raises(Refused, match="has not moved"):
        stage.arm.back_off(stage.t, 0.03)


def test_joints_that_do_not_follow_are_not_settled(robot):
    stage = Stage(make_arm(robot), motor=lambda q, v: (HOME, np.zeros(6)))
    log = stage.run(joints_goal())
    assert (log.outcome.state, log.outcome.cause) == ("failed", "not_settled")
    assert "-57.296° and tool0 516.16 mm off" in log.outcome.text
    assert np.allclose(stage.arm.at(stage.t).position, HOME)
