import numpy as np
import pinocchio as pin
import pytest
from support.services.manipulator import (
    DOWN,
    HOME,
    JOINTS,
    PERIOD,
    STANDING,
    UR5,
    Log,
    PlantMotor,
    Stage,
    make_arm,
    make_limits,
    make_robot,
    pose_goal,
    with_effort,
)

from stepbus_kinematics import RobotModel
from stepbus_motion.goals.outcome import Refused
from stepbus_motion.manipulator.manipulator import Beside
from stepbus_motion.motions.joint_motion import JointMotion, motion_to
from stepbus_schemas import BaseState, Goal, Plan
from stepbus_schemas.messages import Spiral

TIP = "tool0"
AROUND = Spiral(centre=(0.45, 0.0, 0.3), radius=(0.3, 0.1), turns=2.0, rise=0.2)
SPIRAL = pose_goal("spiral", [0.45, 0.0, 0.6], spiral=AROUND)
ASIDE = HOME + np.array([0.8, 0.2, -0.3, 0.2, 0.1, -1.0])


@pytest.fixture(scope="module")
def robot():
    return make_robot()


def joints_goal(q=ASIDE, **fields):
    values = [float(x) for x in q]
    return Goal(id=0, type="move_joints", joints=list(JOINTS), values=values, **fields)


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


def tips(robot, rows):
    return np.array([robot.frame_pose(q, TIP).translation for q in rows])


def refusal(stage, goal, **begin):
    with pytest.raises(Refused) as refused:
        stage.start(goal, **begin)
    return refused.value


def test_joints_move_within_their_limits_and_settle(robot):
    log = Stage(make_arm(robot)).run(joints_goal())
    limits = make_limits(robot)
    assert log.outcome.state == "succeeded"
    assert np.allclose(log.q[-1], ASIDE)
    assert (np.abs(log.speed()) <= limits.velocity + 1e-9).all()
    assert (np.abs(log.push()) <= limits.acceleration + 1e-9).all()


def test_the_commanded_velocity_takes_each_position_to_the_next(robot):
    log = Stage(make_arm(robot)).run(SPIRAL)
    ahead = np.array(log.q[:-1]) + PERIOD * np.array(log.v[:-1])
    assert np.abs(ahead - np.array(log.q[1:])).max() < 1e-9


def test_a_pose_is_reached_by_the_nearest_branch(robot):
    target = [0.5, 0.2, 0.35]
    stage = Stage(make_arm(robot))
    text = stage.start(pose_goal("move_to_pose", target))
    log = stage.run()
    assert text.startswith("solution 1 of ")
    assert np.abs(tips(robot, log.q[-1:])[0] - target).max() < 1e-6
    assert np.abs(np.array(log.q[-1]) - HOME).max() < 1.7


def test_a_duration_is_kept_and_one_too_short_is_as_short_as_the_limits_allow(robot):
    slow = Stage(make_arm(robot)).run(joints_goal(duration=4.0))
    fast = Stage(make_arm(robot)).run(joints_goal(duration=0.1))
    assert slow.steps * PERIOD == pytest.approx(4.0 + 5 * PERIOD, abs=2 * PERIOD)
    assert 0.5 < fast.steps * PERIOD < 2.0


@pytest.mark.parametrize(
    ("base", "frame"),
    [
        (BaseState(x=1.5, y=-0.5, yaw=np.pi / 2, vx=0, wz=0), "odometry"),
        (STANDING, "wrist_2_link"),
    ],
)
def test_a_pose_may_be_given_in_odometry_or_in_a_link(robot, base, frame):
    wanted = pin.SE3(DOWN.rotation, np.array([0.5, 0.2, 0.35]))
    yaw = pin.exp3(np.array([0, 0, base.yaw]))
    places = {
        "odometry": pin.SE3(yaw, np.array([base.x, base.y, 0.0])).inverse(),
        "wrist_2_link": robot.frame_pose(HOME, "wrist_2_link"),
    }
    given = places[frame].inverse() * wanted
    goal = pose_goal("move_to_pose", given.translation, given.rotation, frame=frame)
    log = Stage(make_arm(robot)).run(goal, base=base)
    assert np.abs(robot.frame_pose(log.q[-1], TIP).homogeneous - wanted.homogeneous).max() < 1e-6


def test_a_line_is_straight_and_keeps_the_limits_of_the_tip(robot):
    to = np.array([0.55, -0.25, 0.3])
    log = Stage(make_arm(robot)).run(pose_goal("move_linear", to))
    way = tips(robot, log.q)
    along = (to - way[0]) / np.linalg.norm(to - way[0])
    across = (way - way[0]) - np.outer((way - way[0]) @ along, along)
    speed = np.linalg.norm(np.diff(way, axis=0), axis=1) / PERIOD
    assert np.linalg.norm(across, axis=1).max() < 1e-6
    assert 0.2 < speed.max() <= 0.2501
    assert np.abs(np.diff(speed)).max() / PERIOD <= 0.501
    assert np.abs(way[-1] - to).max() < 1e-6


def test_a_line_near_the_shoulder_is_slowed_down_to_the_joint_limits(robot):
    near = pose_goal("move_linear", [0.18, 0.3, 0.3])
    quick = make_arm(robot, tip_velocity=5.0, tip_acceleration=50.0, tip_jerk=500.0)
    log = Stage(quick).run(near)
    limits = make_limits(robot)
    share = np.abs(log.speed()) / limits.velocity, np.abs(log.push()) / limits.acceleration
    assert 0.9 < max(share[0].max(), share[1].max()) <= 1.01


@pytest.mark.parametrize(
    ("goal", "cause", "text"),
    [
        (pose_goal("move_linear", [1.3, 0, 0.3]), "unreachable", "closest pose is"),
        (pose_goal("move_to_pose", [1.3, 0, 0.3]), "unreachable", "closest pose is"),
        (pose_goal("move_linear", [-0.55, 0.0, 0.3]), "singular", "m of the path"),
        (pose_goal("move_to_pose", [0.5, 0, 0.3], tip="tool"), "invalid", "did you mean"),
        (pose_goal("move_to_pose", [0.5, 0, 0.3], tip="world"), "invalid", "no joint of this"),
        (pose_goal("move_to_pose", [0.5, 0, 0.3], frame="odo"), "invalid", "'odo'"),
        (pose_goal("move_to_pose", [0.5, 0, 0.3], duration=-1.0), "invalid", "duration is -1 s"),
        (Goal(id=0, type="move_linear", tip=TIP), "invalid", "needs position and orientation"),
        (joints_goal([0, 0, 9, 0, 0, 0]), "invalid", "its limits are"),
        (Goal(id=0, type="move_joints", joints=["elbow"], values=[0]), "invalid", "elbow_joint"),
        (pose_goal("spiral", [0.4, 0, 0.5]), "invalid", "needs spiral"),
        (Goal(id=0, type="drive", by=1.0), "invalid", "no goals of type drive"),
    ],
)
def test_what_cannot_be_done_is_refused_with_its_cause(robot, goal, cause, text):
    refused = refusal(Stage(make_arm(robot)), goal)
    assert refused.cause == cause
    assert text in str(refused)


def test_a_pose_that_the_motors_cannot_hold_is_refused():
    weak = with_effort(RobotModel(UR5, JOINTS), [150, 30, 150, 28, 28, 28])
    goal = pose_goal("move_to_pose", [0.75, 0.1, 0.3])
    refused = refusal(Stage(make_arm(weak)), goal)
    assert refused.cause == "not_holdable"
    assert "shoulder_lift_joint needs" in str(refused)


def test_torques_on_the_way_stay_within_their_share_of_the_limits(robot):
    static = np.abs([robot.gravity_torque(q) for q in (HOME, ASIDE)]).max(axis=0)
    tight = with_effort(RobotModel(UR5, JOINTS), (1.4 * static + 3.0).tolist())
    log = Stage(make_arm(tight)).run(joints_goal())
    free = Stage(make_arm(robot)).run(joints_goal())
    v, a = log.speed(), log.push()
    rows = zip(log.q[1:], v, a, strict=False)
    torques = np.abs([tight.inverse_dynamics(*row) for row in rows])
    assert log.outcome.state == "succeeded"
    assert log.steps > free.steps
    assert (torques <= 0.92 * tight.effort_limit).all()


def test_the_spiral_narrows_around_the_vertical_then_goes_straight_to_the_end(robot):
    stage = Stage(make_arm(robot))
    text = stage.start(SPIRAL)
    way = tips(robot, stage.run().q)
    radius = np.hypot(way[:, 0] - 0.45, way[:, 1])
    first = int(np.argmin(np.abs(radius - 0.3) + np.abs(way[:, 2] - 0.3)))
    last = int(np.argmin(np.abs(radius - 0.1) + np.abs(way[:, 2] - 0.5)))
    around = way[first : last + 1]
    turned = np.unwrap(np.arctan2(around[:, 1], around[:, 0] - 0.45))
    assert turned[-1] - turned[0] == pytest.approx(4 * np.pi, abs=1e-2)
    assert (np.diff(radius[first : last + 1]) < 1e-9).all()
    assert np.allclose(way[-1], [0.45, 0.0, 0.6], atol=1e-6)
    assert "2 turns" in text
    assert "then 0.14 m straight" in text


def test_points_of_a_spiral_out_of_reach_are_raised_and_counted(robot):
    low = Spiral(centre=(0.45, 0.0, -0.55), radius=(0.3, 0.1), turns=2.0, rise=0.2)
    stage = Stage(make_arm(robot))
    text = stage.start(pose_goal("spiral", [0.5, 0.0, 0.0], spiral=low))
    way = tips(robot, stage.run().q)
    count = int(text.split(" of its 49 points raised")[0].split()[-1])
    assert 0 < count < 49
    assert np.allclose(way[-1], [0.5, 0.0, 0.0], atol=1e-6)


def test_a_spiral_that_raising_does_not_save_names_its_point(robot):
    far = Spiral(centre=(1.2, 0.0, 0.3), radius=(0.3, 0.1), turns=2.0, rise=0.2)
    refused = refusal(Stage(make_arm(robot)), pose_goal("spiral", [0.5, 0, 0.4], spiral=far))
    assert refused.cause == "unreachable"
    assert "raising it by 0.5 m did not help" in str(refused)


@pytest.mark.parametrize("goal", [SPIRAL, pose_goal("move_linear", [0.5, 0.3, 0.4])])
def test_the_plant_follows_within_a_millimetre(robot, goal, tmp_path):
    log = Stage(make_arm(robot), PlantMotor(tmp_path)).run(goal)
    off = np.linalg.norm(tips(robot, log.q) - tips(robot, log.measured), axis=1)
    assert log.outcome.state == "succeeded"
    assert off.max() < 1e-3


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
    assert 4.5 < np.abs(log.push()).max() <= 12.0 + 1e-6
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
    assert "wrist_3_joint is -57.296° and tool0 516.16 mm off" in log.outcome.text
    assert np.allclose(stage.arm.at(stage.t).position, HOME)


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
    assert log.outcome.text == "4 solutions were tried; the last: no path for request 3"
    assert len({tuple(np.round(request.goal, 6)) for request in stage.requests}) == 4


def test_beside_a_base_that_drives_no_posture_far_away_is_tried(robot):
    stage = Stage(planned_arm(robot), answer=bad_planner)
    beside = Beside(bases=[(0.0, 0.0, 0.0)], waits=True)
    goal = pose_goal("move_to_pose", [0.5, 0.2, 0.35])
    stage.arm.start(goal, stage.q, STANDING, stage.t, beside=beside)
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
    old = stage.arm.request()
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


def test_the_same_goals_give_the_same_commands_to_the_bit():
    def commands():
        robot = make_robot()
        stage = Stage(make_arm(robot))
        for goal in (pose_goal("move_to_pose", [0.5, 0.2, 0.35]), SPIRAL):
            yield np.array(stage.run(goal).q).tobytes()

    assert list(commands()) == list(commands())


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
