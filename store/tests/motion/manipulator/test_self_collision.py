"""The store's arm does not pass through the robot: lines, spirals, motions and stops."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from support.services.manipulator import JOINTS, Stage, make_limits, pose_goal
from support.store_paths import SCENARIOS

from stepbus_kinematics import RobotModel, SelfCollisions, collision_geometry
from stepbus_schemas import Goal
from stepbus_schemas.messages import Spiral
from stepbus_store.motion.branches import BranchSolver
from stepbus_store.motion.candidates import CandidateFinder
from stepbus_store.motion.joint_motion import JointMotion, ManipulatorOptions, motion_to
from stepbus_store.motion.joint_params import JointParams
from stepbus_store.motion.manipulator import Manipulator
from stepbus_store.motion.outcome import Measured, Refused
from stepbus_store.motion.player import MotionPlayer, stop_on_path

STORE = SCENARIOS / "store"
READY = np.array([0.0, -1.6, 1.9, -1.87, -np.pi / 2, -np.pi / 2])
DOWN = np.diag([1.0, -1.0, -1.0])
TUCK = (0.0, -2.9, 2.7, -1.6, -np.pi / 2, -np.pi / 2)


@pytest.fixture(scope="module")
def robot():
    open_ = {"left_finger": 0.045, "right_finger": 0.045}
    return RobotModel(STORE / "robot.urdf.xacro", JOINTS, posture=open_, bounded=True)


@pytest.fixture(scope="module")
def collisions(robot):
    return SelfCollisions(robot, STORE / "robot.srdf", 0.002)


@pytest.fixture(params=[True, False], ids=["planner", "no planner"])
def stage(request, robot, collisions):
    arm = Manipulator(
        robot,
        make_limits(robot),
        JointParams(model=Path(), joints=(), settle_timeout=0.5),
        ManipulatorOptions(period=0.008, tip="grasp"),
        seed=0,
        uses_planner=request.param,
        collisions=collisions,
    )
    arm.hold(READY)
    stage = Stage(arm)
    stage.q = READY
    return stage


def spiral(x, radius):
    around = Spiral(centre=(x, 0.0, 0.35), radius=(radius, 0.1), turns=2.0, rise=0.2)
    return pose_goal("spiral", (x, 0.0, 0.6), DOWN, tip="grasp", spiral=around)


def candidates(robot, collisions, goal):
    options = ManipulatorOptions(period=0.008, tip="grasp")
    solver = BranchSolver(robot, effort_share=options.effort_share, seed=0, collisions=collisions)
    return CandidateFinder(solver, options).candidates(goal, READY, Measured(q=READY, v=0 * READY))


def touches(robot, candidate):
    """Return the links that touch on the way, found pair by pair and without a margin."""
    geometry = collision_geometry(robot, STORE / "robot.srdf")
    data, results, found = robot.model.createData(), geometry.createData(), set()
    for path in candidate.paths:
        for u in np.linspace(path.u[0], path.u[-1], 300):
            q = robot.in_model(path.at(u)[0])
            pin.computeCollisions(robot.model, data, geometry, results, q, False)
            for pair, result in zip(geometry.collisionPairs, results.collisionResults, strict=True):
                if result.isCollision():
                    items = (geometry.geometryObjects[k] for k in (pair.first, pair.second))
                    found.add(tuple(robot.model.frames[i.parentFrame].name for i in items))
    return found


def test_of_a_spiral_only_the_solutions_that_do_not_touch_the_robot_are_left(robot, collisions):
    goal = spiral(0.55, 0.2)
    unchecked = next(candidates(robot, None, goal))
    assert ("upper_arm_link", "wrist_1_link") in touches(robot, unchecked)
    assert touches(robot, next(candidates(robot, collisions, goal))) == set()


def test_a_spiral_through_the_chassis_is_refused_with_the_links(robot, collisions):
    with pytest.raises(Refused, match=r"touch \w+ after \d\.\d+ m of the path") as caught:
        next(candidates(robot, collisions, spiral(0.55, 0.3)))
    assert caught.value.cause == "in_collision"


def test_a_line_into_the_chassis_is_refused_with_the_links(stage):
    goal = pose_goal("move_linear", (0.28, 0.1, 0.45), DOWN, tip="grasp")
    with pytest.raises(Refused, match=r"would touch"):
        stage.start(goal)


@pytest.mark.parametrize("stage", [False], indirect=True, ids=["no planner"])
def test_a_motion_without_a_planner_does_not_pass_through_the_robot(stage):
    into = [*TUCK[:3], -0.9, *TUCK[4:]]
    with pytest.raises(Refused, match=r"would touch"):
        stage.start(Goal(id=0, type="move_joints", joints=list(JOINTS), values=into))


class OffThePath:
    """Says that the robot touches itself wherever the first two joints are not equal."""

    def any(self, q):
        return abs(q[0] - q[1]) > 1e-6


def test_a_stop_that_would_touch_the_robot_stays_on_the_path(robot):
    limits = make_limits(robot)
    # The second joint is slower than the first one, so that by itself it stops earlier.
    limits.acceleration[1], limits.jerk[1] = 8.0, 80.0
    far = READY.copy()
    far[:2] += 1.0
    start = READY.copy()
    start[1] = start[0]
    far[1] = far[0]
    ends = []
    for collisions in (None, OffThePath()):
        options = ManipulatorOptions(
            period=0.008, tip="grasp", brake_acceleration=12.0, brake_jerk=400.0
        )
        player = MotionPlayer(robot, limits, options, collisions)
        player.start(motion_to(JointMotion.at_rest(start), far, make_limits(robot)))
        player.advance(0.5, 1.0)
        ends.append(player.brake(player.at(0.5)))
        states = [player.trajectory.at(t) for t in np.linspace(0, player.trajectory.duration, 50)]
        push = np.abs([state.acceleration for state in states]).max(axis=0)
        assert np.all(push <= 12.0 + 1e-6)
    assert abs(ends[0][0] - ends[0][1]) > 1e-3
    assert abs(ends[1][0] - ends[1][1]) < 1e-6


def test_a_stop_on_the_path_starts_with_the_velocity_of_the_motion(robot):
    motion = motion_to(JointMotion.at_rest(READY), READY + 0.5, make_limits(robot))
    stop = stop_on_path(motion, 0.3, 0.5, make_limits(robot))
    now = motion.at(0.3)
    assert stop.at(0.0).position == pytest.approx(now.position)
    assert stop.at(0.0).velocity == pytest.approx(0.5 * now.velocity)
    assert not stop.at(stop.duration).velocity.any()
