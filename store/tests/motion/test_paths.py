import numpy as np
import pinocchio as pin
import pytest
from support.services.manipulator import DOWN, HOME, UR5, make_limits, make_robot, with_effort

from stepbus_kinematics import RobotModel
from stepbus_schemas import Plan
from stepbus_store.motion.fitting import fitted
from stepbus_store.motion.follow import JointPath, PathLost, follow, joint_path, line
from stepbus_store.motion.joint_clock import MotionClock
from stepbus_store.motion.joint_motion import JointMotion, MotionLimits, motion_to
from stepbus_store.motion.outcome import Refused
from stepbus_store.motion.player import planned
from stepbus_store.motion.spiral import SpiralCurve
from stepbus_store.motion.trajectory import along_path

TIP = "tool0"


@pytest.fixture(scope="module")
def robot():
    return make_robot()


def cubic(count=5):
    """Return a path of two joints that a cubic gives exactly, and the functions it is made of."""
    u = np.linspace(0.0, 2.0, count)
    q = np.stack([u**3, 1 - u], axis=1)
    slope = np.stack([3 * u**2, -np.ones(count)], axis=1)
    return JointPath(u=u, q=q, slope=slope)


def one(velocity=1.0, acceleration=2.0, jerk=20.0):
    rows = (np.array([x]) for x in (velocity, acceleration, jerk))
    return MotionLimits(**dict(zip(("velocity", "acceleration", "jerk"), rows, strict=True)))


def make_plan(motion, count=20):
    times = np.linspace(0.0, motion.duration, count)
    states = [motion.at(t) for t in times]
    return Plan(
        id=3,
        times=times.tolist(),
        position=[s.position.tolist() for s in states],
        velocity=[s.velocity.tolist() for s in states],
    )


def moving(robot, goal=None):
    goal = HOME + np.array([0.8, 0.3, -0.4, 0.2, 0.1, -1.0]) if goal is None else goal
    return motion_to(JointMotion.at_rest(HOME), goal, make_limits(robot)), goal


def test_along_a_path_velocity_and_acceleration_are_derivatives_of_the_position():
    motion = along_path(cubic(), one())
    h = 1e-5
    for t in np.linspace(0.1, motion.duration - 0.1, 20):
        before, now, after = (motion.at(x) for x in (t - h, t, t + h))
        assert np.allclose(now.velocity, (after.position - before.position) / (2 * h), atol=1e-5)
        push = (after.velocity - before.velocity) / (2 * h)
        assert np.allclose(now.acceleration, push, atol=2e-2)


def test_a_motion_through_a_pose_that_cannot_be_held_is_refused(robot):
    motion, _ = moving(robot, HOME - np.array([0, 0.3, 0.9, 0, 0, 0]))
    here, there = (np.abs(robot.gravity_torque(motion.at(t).position))[2] for t in (0.0, 9.0))
    weak = with_effort(RobotModel(UR5, robot.joints), [150, 150, (here + there) / 2, 28, 28, 28])
    with pytest.raises(Refused, match="elbow_joint needs") as refused:
        fitted(motion, weak, make_limits(robot))
    assert refused.value.cause == "not_holdable"


def test_a_plan_begins_exactly_where_the_arm_is(robot):
    motion, goal = moving(robot)
    off = np.full(6, 5e-4)
    timed = planned(make_plan(motion), HOME + off, goal, robot)
    assert np.array_equal(timed.at(0.0).position, HOME + off)
    assert np.array_equal(timed.at(timed.duration).position, goal)


def test_a_plan_from_or_to_elsewhere_is_refused(robot):
    motion, goal = moving(robot)
    with pytest.raises(Refused, match=r"-1\.2000 rad for shoulder_lift"):
        planned(make_plan(motion), HOME + np.array([0, 0.1, 0, 0, 0, 0]), goal, robot)
    with pytest.raises(Refused, match="has its end at"):
        planned(make_plan(motion), HOME, goal + 0.1, robot)


def test_the_tip_stays_on_a_straight_line_and_turns_evenly(robot):
    start = robot.frame_pose(HOME, TIP)
    end = pin.SE3(
        start.rotation @ pin.exp3(np.array([0.3, 0.2, 0.5])),
        start.translation + np.array([-0.1, 0.3, 0.1]),
    )
    way = line(start, end, 0.25)
    path = follow(robot, TIP, way, HOME)
    whole = pin.log3(start.rotation.T @ end.rotation)
    for share in np.linspace(0, 1, 101):
        pose = robot.frame_pose(path.at(share * way[-1].u)[0], TIP)
        wanted = start.translation + share * (end.translation - start.translation)
        assert np.linalg.norm(pose.translation - wanted) < 1e-6
        assert np.allclose(pin.log3(start.rotation.T @ pose.rotation), share * whole, atol=1e-5)


def test_a_turn_on_the_spot_has_a_length():
    end = pin.SE3(DOWN.rotation @ pin.exp3(np.array([0, 0, 1.0])), np.zeros(3))
    assert line(DOWN, end, 0.25)[-1].u == pytest.approx(0.25)
    assert line(DOWN, DOWN, 0.25) == []


def test_a_line_that_winds_a_joint_up_to_its_limit_is_lost_there(robot):
    narrow = make_robot()
    narrow.upper = HOME + 0.4
    start = robot.frame_pose(HOME, TIP)
    way = line(start, pin.SE3(start.rotation, start.translation + np.array([0, 0.4, 0])), 0.25)
    with pytest.raises(PathLost, match=r"would have to go to 0\.4") as lost:
        follow(narrow, TIP, way, HOME)
    assert lost.value.cause == "limits"


def make_curve(raised=()):
    lifts = np.zeros(49)
    for place in raised:
        lifts[place] = 0.05
    return SpiralCurve(
        centre=np.array([0.45, 0.0, 0.3]),
        radius=(0.3, 0.1),
        turns=2.0,
        rise=0.2,
        starts_at=0.5,
        rotation=DOWN.rotation,
        raised=lifts,
    )


def test_the_length_of_a_spiral_is_that_of_its_way():
    poses = make_curve().poses()
    fine = np.array([make_curve().at(s)[0].translation for s in np.linspace(0, 1, 20001)])
    assert poses[-1].u == pytest.approx(
        np.linalg.norm(np.diff(fine, axis=0), axis=1).sum(), abs=1e-5
    )
    assert all(np.linalg.norm(pose.twist) == pytest.approx(1.0) for pose in poses)


def test_a_raised_point_lifts_the_way_around_it_smoothly():
    flat, raised = make_curve(), make_curve([24])
    shares = np.linspace(0, 1, 4801)
    lift = np.array([raised.at(s)[0].translation[2] - flat.at(s)[0].translation[2] for s in shares])
    assert lift[2400] == pytest.approx(0.05)
    assert not lift[(shares < 23 / 48) | (shares > 25 / 48)].any()
    assert np.abs(np.diff(lift, 2)).max() < 3e-5


def test_whatever_the_scale_a_motion_keeps_its_limits_of_acceleration_and_nearly_those_of_jerk():
    one, dt, random = np.ones(6), 0.016, np.random.default_rng(0)
    limits = MotionLimits(velocity=1.5 * one, acceleration=3.0 * one, jerk=40.0 * one)
    for _ in range(10):
        motion = motion_to(JointMotion.at_rest(0.0 * one), random.uniform(-1.5, 1.5, 6), limits)
        clock, scale, wanted, rows = MotionClock(3.0 * one, 40.0 * one), 1.0, 1.0, [0.0 * one] * 3
        while clock.s < motion.duration:
            wanted = random.choice([0.2, 0.5, 1.0]) if random.random() < 0.1 else wanted
            scale += min(max(wanted - scale, -4.0 * dt), 4.0 * dt)
            rows.append(motion.at(clock.s).position)
            clock.advance(dt, scale, motion)
        assert np.abs(np.diff(rows, n=2, axis=0)).max() / dt**2 <= 3.0 * 1.02
        assert np.abs(np.diff(rows, n=3, axis=0)).max() / dt**3 <= 40.0 * 1.5


def test_a_path_is_slowed_until_it_keeps_the_limits_of_jerk():
    robot, start = make_robot(), HOME
    limits = make_limits(robot)
    jerks = np.full(6, 5.0)
    strict = MotionLimits(velocity=limits.velocity, acceleration=limits.acceleration, jerk=jerks)
    path = joint_path([start, start + 0.3, start + np.array([0.3, 0.6, 0.3, 0.3, 0.3, 0.3])])
    quick = along_path(path, MotionLimits.of_one(1.0, 3.0, 100.0))
    motion = fitted(quick, robot, strict)
    times = np.arange(0.0, motion.duration, 0.016)
    pushes = np.array([motion.at(t).acceleration for t in times])
    assert motion.duration > quick.duration
    assert np.abs(np.diff(pushes, axis=0)).max() / 0.016 <= 1.2 * 5.0
