"""Baxter: poses of both hands are found, touching links are named, and paths lead around them."""

import numpy as np
import pytest

from stepbus_kinematics import RobotModel, SelfCollisions
from stepbus_participant import package_path
from stepbus_store.motion.ik_search import InverseKinematics
from stepbus_store.motion.joint_motion import MotionLimits
from stepbus_store.motion.routes import DetourRouter
from stepbus_store.motion.trajectory import Joined

ROBOT = "package://example-robot-data/robots/baxter_description/"
JOINTS = [f"{a}_{j}" for a in ("right", "left") for j in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")]
HOME = np.array([0, -1.0, 0, 1.94, 0, 0.67, 0] * 2)
CROSSED = np.array([1.2, -0.1, 0, 0.3, 0, 0, 0, -1.2, -0.1, 0, 0.3, 0, 0, 0])


@pytest.fixture(scope="module")
def robot():
    return RobotModel(package_path(ROBOT + "urdf/baxter.urdf"), JOINTS)


@pytest.fixture(scope="module")
def collisions(robot):
    return SelfCollisions(robot, package_path(ROBOT + "srdf/baxter_manipulation.srdf"), 0.01)


def test_reachable_poses_of_both_hands_are_all_found(robot):
    ik, random = InverseKinematics(robot, seed=0), np.random.default_rng(1)
    for tip in ("left_gripper", "right_gripper") * 20:
        target = robot.frame_pose(random.uniform(robot.lower, robot.upper), tip)
        found = ik.solve(tip, target, HOME)
        assert found.verdict != "unreachable"
        assert (
            np.linalg.norm(robot.frame_pose(found.q, tip).translation - target.translation) < 2e-5
        )


def test_the_limits_of_the_urdf_do_not_hold_a_stretched_arm(robot):
    q = HOME.copy()
    q[7:] = [0, 0.0, 0, 0, 0, 0, 0]
    found = robot.overload(q)
    assert (found.joint, found.available) == ("left_s1", 50.0)
    assert 50.0 < found.required < 60.0


def test_crossed_arms_touch_and_the_links_are_named(collisions):
    assert collisions.pair(HOME) is None
    first, second = sorted(collisions.pair(CROSSED))
    assert first.startswith("left_")
    assert second.startswith("right_")


def test_a_path_is_found_around_the_other_arm(robot, collisions):
    one = np.ones(14)
    limits = MotionLimits(velocity=one, acceleration=4 * one, jerk=40 * one)
    start, goal = HOME.copy(), HOME.copy()
    start[7:], goal[7:] = [-1.2, 0.1, 0, 0.6, 0, 0, 0], [0.7, -0.2, 0, 0.4, 0, 0, 0]
    router = DetourRouter(robot, limits, seed=0, collisions=collisions)
    route = Joined(router.plan(start, goal, holds=False))
    poses = [route.at(t).position for t in np.linspace(0, route.duration, 200)]
    assert not any(collisions.any(q) for q in poses)
    assert poses[-1] == pytest.approx(goal)
