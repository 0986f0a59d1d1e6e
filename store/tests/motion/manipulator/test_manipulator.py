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
    PlantMotor,
    Stage,
    make_arm,
    make_limits,
    pose_goal,
    with_effort,
)
from support.services.ur5 import ASIDE, SPIRAL, TIP, joints_goal, refusal, tips

from stepbus_kinematics import RobotModel
from stepbus_schemas import BaseState, Goal
from stepbus_schemas.messages import Spiral


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
        (joints_goal([0, 0, np.nan, 0, 0, 0]), "invalid", "cannot go to nan rad"),
        (Goal(id=0, type="move_joints", joints=["a"], values=[]), "invalid", "0 values for 1"),
        (pose_goal("move_to_pose", [0.5, 0, 0.3], orientation=(0, 0, 0, 2)), "invalid", "length 2"),
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
    assert "also raised by 0.5 m" in str(refused)


@pytest.mark.parametrize("goal", [SPIRAL, pose_goal("move_linear", [0.5, 0.3, 0.4])])
def test_the_plant_follows_within_a_millimetre(robot, goal, tmp_path):
    log = Stage(make_arm(robot), PlantMotor(tmp_path)).run(goal)
    off = np.linalg.norm(tips(robot, log.q) - tips(robot, log.measured), axis=1)
    assert log.outcome.state == "succeeded"
    assert off.max() < 1e-3
