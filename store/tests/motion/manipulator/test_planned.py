"""An arm with a planner: what it asks, and what it makes of each answer."""

import numpy as np
import pytest
from support.services.manipulator import HOME, PERIOD, Log, Stage, make_arm, make_limits, pose_goal
from support.services.ur5 import ASIDE, SPIRAL, TIP, joints_goal, tips

from stepbus_schemas import Plan
from stepbus_schemas.messages import Spiral
from stepbus_store.motion.joint_motion import JointMotion, motion_to
from stepbus_store.motion.outcome import Measured


def good_planner(robot):
    """Return a planner that goes straight, by its own clock."""

    def answer(request):
        start, goal = np.array(request.start), np.array(request.goal)
        if request.start == request.goal:
            still = {"position": [request.goal] * 2, "velocity": [[0.0] * len(goal)] * 2}
            return Plan(id=request.id, times=[0.0, 0.02], **still)
        motion = motion_to(JointMotion.at_rest(start), goal, make_limits(robot))
        times = np.linspace(0.0, motion.duration, 60)
        states = [motion.at(t) for t in times]
        return Plan(
            id=request.id,
            times=times.tolist(),
            position=[s.position.tolist() for s in states],
            velocity=[s.velocity.tolist() for s in states],
        )

    return answer


def bad_planner(request):
    return Plan(id=request.id, cause="goal_in_collision", text=f"no path for request {request.id}")


def planned_arm(robot, **options):
    return make_arm(robot, uses_planner=True, **options)


def test_with_a_planner_the_plan_is_asked_for_and_followed(robot):
    stage = Stage(planned_arm(robot), answer=good_planner(robot))
    log = stage.run(joints_goal(touches=["shelf"]), held="cola_a1_3")
    asked = stage.requests[0]
    assert log.outcome.state == "succeeded"
    assert np.allclose(log.q[-1], ASIDE)
    assert np.allclose(asked.start, HOME)
    assert (asked.goal, asked.held, asked.touches) == (ASIDE.tolist(), "cola_a1_3", ["shelf"])


def test_with_a_planner_a_duration_is_kept(robot):
    log = Stage(planned_arm(robot), answer=good_planner(robot)).run(joints_goal(duration=4.0))
    assert log.steps * PERIOD == pytest.approx(4.0, abs=0.1)


def test_four_postures_are_tried_before_a_pose_has_no_path(robot):
    stage = Stage(planned_arm(robot), answer=bad_planner)
    log = stage.run(pose_goal("move_to_pose", [0.5, 0.2, 0.35]))
    assert (log.outcome.state, log.outcome.cause) == ("failed", "no_path")
    assert log.outcome.text.startswith("4 solutions were tried")
    assert len({tuple(np.round(request.goal, 6)) for request in stage.requests}) == 4


def test_beside_a_base_that_drives_no_posture_far_away_is_tried(robot):
    stage = Stage(planned_arm(robot), answer=bad_planner)
    goal = pose_goal("move_to_pose", [0.5, 0.2, 0.35])
    now = Measured(q=stage.q, v=stage.v)
    stage.arm.start(goal, now, stage.t, bases=[(0.0, 0.0, 0.0)])
    log = stage.run()
    far = [np.linalg.norm(np.subtract(request.goal, HOME)) for request in stage.requests]
    assert log.outcome.state == "failed"
    assert len(far) < 4
    assert max(far) <= far[0] + 1.5


@pytest.mark.parametrize(
    ("said", "cause"),
    [("no_path", "no_path"), ("not_holdable", "not_holdable"), ("bad_request", "invalid")],
)
def test_the_goal_fails_with_what_the_planner_says(robot, said, cause):
    def planner(request):
        return Plan(id=request.id, cause=said, text="why")

    log = Stage(planned_arm(robot), answer=planner).run(joints_goal())
    assert (log.outcome.cause, log.outcome.text) == (cause, "why")


def test_the_next_way_to_stand_is_taken_where_the_first_has_none(robot):
    good = good_planner(robot)

    def second(request):
        return bad_planner(request) if request.id == 0 else good(request)

    stage = Stage(planned_arm(robot), answer=second)
    log = stage.run(pose_goal("move_to_pose", [0.5, 0.2, 0.35]))
    assert log.outcome.state == "succeeded"
    assert np.allclose(log.q[-1], stage.requests[1].goal)
    assert np.abs(tips(robot, log.q[-1:])[0] - [0.5, 0.2, 0.35]).max() < 1e-6


def test_a_planner_that_does_not_answer_ends_the_goal(robot):
    log = Stage(planned_arm(robot, plan_timeout=0.5)).run(joints_goal())
    assert (log.outcome.state, log.outcome.cause) == ("failed", "no_plan")
    assert log.steps * PERIOD == pytest.approx(0.5, abs=0.02)


def test_an_answer_to_an_older_request_is_ignored(robot):
    stage = Stage(planned_arm(robot))
    stage.start(joints_goal())
    old = stage.arm.queries.pop()
    stage.start(joints_goal(HOME + 0.1))
    stage.arm.take_plan(good_planner(robot)(old), stage.t)
    log = Log()
    stage.step(log)
    assert not log.v[-1].any()
    assert stage.requests[0].id == old.id + 1


def test_a_plan_that_starts_elsewhere_is_a_bad_plan(robot):
    def elsewhere(request):
        plan = good_planner(robot)(request)
        return Plan(
            id=plan.id,
            times=plan.times,
            velocity=plan.velocity,
            position=[[x + 0.1 for x in row] for row in plan.position],
        )

    log = Stage(planned_arm(robot), answer=elsewhere).run(joints_goal())
    assert (log.outcome.state, log.outcome.cause) == ("failed", "bad_plan")
    assert "has its start at" in log.outcome.text


def test_a_goal_in_full_motion_is_planned_from_where_the_arm_comes_to_rest(robot):
    stage, log = Stage(planned_arm(robot), answer=good_planner(robot)), Log()
    stage.start(joints_goal())
    for _ in range(60):
        stage.step(log)
    stage.start(joints_goal(HOME))
    log.outcome = None
    while log.outcome is None:
        stage.step(log)
    assert log.outcome.state == "succeeded"
    assert np.allclose(log.q[-1], HOME)
    assert np.abs(np.array(stage.requests[1].start) - log.q[59]).max() > 0.01
    assert np.abs(log.push()).max() <= 6.0


def test_a_spiral_is_led_in_by_the_planner(robot):
    stage = Stage(planned_arm(robot), answer=good_planner(robot))
    log = stage.run(SPIRAL)
    begins = robot.frame_pose(np.array(stage.requests[0].goal), TIP).translation
    assert log.outcome.state == "succeeded"
    assert np.hypot(begins[0] - 0.45, begins[1]) == pytest.approx(0.3)
    assert np.allclose(tips(robot, log.q[-1:])[0], [0.45, 0.0, 0.6], atol=1e-6)


def home_tip(robot):
    return tips(robot, [HOME])[0].tolist()


def line_down(robot):
    x, y, z = home_tip(robot)
    return pose_goal("move_linear", [x, y, z - 0.1])


def test_with_a_planner_a_line_is_checked_before_it_starts(robot):
    stage = Stage(planned_arm(robot), answer=good_planner(robot))
    log = stage.run(line_down(robot), held="cola_a1_3")
    (asked,) = stage.requests
    assert asked.start == asked.goal
    assert asked.held == "cola_a1_3"
    x, y, z = home_tip(robot)
    assert tips(robot, np.array(asked.path))[-1] == pytest.approx([x, y, z - 0.1], abs=1e-4)
    assert log.outcome.state == "succeeded"


def test_a_line_that_is_blocked_does_not_start(robot):
    def blocks(request):
        return Plan(id=request.id, cause="path_collides", text="hand touches shelf")

    log = Stage(planned_arm(robot), answer=blocks).run(line_down(robot))
    assert (log.outcome.cause, log.outcome.text) == ("blocked", "hand touches shelf")
    assert np.abs(np.array(log.q) - HOME).max() == 0.0


def test_what_comes_onto_a_line_under_way_is_reported(robot):
    arm = planned_arm(robot)
    stage, log = Stage(arm, answer=good_planner(robot)), Log()
    stage.start(line_down(robot))
    for _ in range(40):
        stage.step(log)
    assert arm.blocked == ""
    arm.take_plan(Plan(id=stage.requests[-1].id, cause="blocked", text="a post"), stage.t)
    assert (arm.blocked, arm.follows_plan) == ("a post", False)


def test_a_long_path_is_checked_at_a_bounded_number_of_points(robot):
    stage = Stage(planned_arm(robot), answer=good_planner(robot))
    turns = Spiral(centre=tuple(home_tip(robot)), radius=(0.1, 0.1), turns=20, rise=0.0)
    stage.run(pose_goal("spiral", home_tip(robot), spiral=turns), steps=20)
    assert 200 < len(stage.requests[0].path) < 600
