import numpy as np
import pinocchio as pin
import pytest
from support.services.manipulator import DOWN, HOME, make_robot

from stepbus_kinematics import RobotModel
from stepbus_participant import package_path
from stepbus_schemas import RunError
from stepbus_store.motion.branches import AnalyticChain, BranchSolver
from stepbus_store.motion.outcome import Refused

BAXTER = package_path("package://example-robot-data/robots/baxter_description/urdf/baxter.urdf")
LEFT = [f"left_{name}" for name in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")]


@pytest.fixture(scope="module")
def robot():
    return make_robot()


def solver(robot):
    return BranchSolver(robot, seed=0)


def draw(count, seed=0):
    return np.random.default_rng(seed).uniform(-3.1, 3.1, (count, 6))


def miss(robot, q, target, tip="tool0"):
    """Return the largest difference of any entry of the pose [m, -]."""
    return np.abs(robot.frame_pose(q, tip).homogeneous - target.homogeneous).max()


def above(x, y, z):
    """Return the tip looking down at a place in the base [m]."""
    return pin.SE3(DOWN.rotation, np.array([x, y, z]))


def refusal(robot, target, q=HOME):
    with pytest.raises(Refused) as refused:
        solver(robot).solve("tool0", target, q)
    return refused.value


def test_every_branch_of_a_random_pose_reaches_it_to_a_micrometre(robot):
    chain = AnalyticChain(robot, "tool0")
    targets = [robot.frame_pose(q, "tool0") for q in draw(100)]
    errors = [miss(robot, way, t) for t in targets for way in chain.branches(t, HOME)]
    assert len(errors) > 700
    assert max(errors) < 1e-6


def test_the_joints_that_made_a_pose_are_among_its_branches(robot):
    chain = AnalyticChain(robot, "tool0")
    for q in draw(100, seed=1):
        branches = chain.branches(robot.frame_pose(q, "tool0"), HOME)
        assert min(np.abs(way - q).max() for way in branches) < 1e-6


def test_all_ways_keep_limits_and_singularities(robot):
    ways = solver(robot).solve("tool0", above(0.5, 0.1, 0.2), HOME)
    assert len(ways) > 8
    assert all((robot.lower <= way).all() and (way <= robot.upper).all() for way in ways)
    assert min(solver(robot).smallest("tool0", way) for way in ways) >= 0.01


def test_each_branch_comes_once_the_nearest_first_before_any_full_turn(robot):
    ways = solver(robot).solve("tool0", above(0.5, 0.1, 0.2), HOME)
    wrapped = [tuple(np.round(np.remainder(way, 2 * np.pi), 6)) for way in ways]
    count = len(set(wrapped))
    assert len(set(wrapped[:count])) == count < len(ways)
    far = [float(np.linalg.norm((way - HOME) / robot.velocity_limit)) for way in ways]
    assert far[:count] == sorted(far[:count])
    assert far[count:] == sorted(far[count:])


def test_a_full_turn_of_the_nearest_branch_is_chosen_where_the_arm_is_wound_up(robot):
    wound = HOME + np.array([0, 0, 0, 0, 0, 2 * np.pi])
    ways = solver(robot).solve("tool0", robot.frame_pose(HOME, "tool0"), wound)
    assert np.allclose(ways[0], wound, atol=1e-6)


def test_a_pose_too_far_away_is_unreachable_by_the_missing_millimetres(robot):
    refused = refusal(robot, above(1.2, 0.0, 0.2))
    assert refused.cause == "unreachable"
    millimetres = float(str(refused).split("closest pose is ")[1].split(" mm")[0])
    reach = 0.425 + 0.39225 + 0.09465
    assert 1e3 * (1.2 - 0.05 - reach) < millimetres < 500


def test_a_stretched_arm_is_singular_with_its_singular_value(robot):
    stretched = np.array([0.0, -0.8, 0.001, -1.0, 0.01, 0.0])
    refused = refusal(robot, robot.frame_pose(stretched, "tool0"))
    assert refused.cause == "singular"
    assert "at least 0.0100 is needed" in str(refused)


def test_a_pose_that_only_a_joint_beyond_its_limits_reaches_names_it(robot):
    narrow = make_robot()
    narrow.lower, narrow.upper = HOME - 0.3, HOME + 0.3
    target = robot.frame_pose(HOME + np.array([0, 0, 0, 0, 0, 0.5]), "tool0")
    refused = refusal(narrow, target)
    assert refused.cause == "limits"
    assert "rad, its limits are [-0.300, 0.300]" in str(refused)


def test_a_chain_of_seven_joints_is_searched_instead():
    robot = RobotModel(BAXTER, LEFT)
    target = robot.frame_pose(np.array([0.1, -0.5, 0.2, 1.0, 0.1, 0.7, 0.0]), "left_gripper")
    one = solver(robot)
    ways = one.solve("left_gripper", target, np.zeros(7))
    assert not one.chain("left_gripper").solves
    assert miss(robot, ways[0], target, "left_gripper") < 1e-4


def test_a_frame_that_no_joint_moves_or_nobody_knows_is_an_error(robot):
    with pytest.raises(RunError, match="controller moves tip 'base_link'"):
        solver(robot).solve("base_link", above(0.5, 0, 0.2), HOME)
    with pytest.raises(RunError, match="tool1"):
        solver(robot).solve("tool1", above(0.5, 0, 0.2), HOME)


def test_the_arm_of_the_store_reaches_every_tier_of_a_shelf_from_above():
    robot = make_robot(package_path("package://stepbus_store/scenarios/store/robot.urdf.xacro"))
    one = solver(robot)
    assert one.chain("grasp").solves
    for x, z in ((0.515, 0.2), (0.645, 0.35), (0.775, 0.5)):
        target = above(x, 0.0, z + 0.1)
        ways = one.solve("grasp", target, HOME)
        assert miss(robot, ways[0], target, "grasp") < 1e-6
