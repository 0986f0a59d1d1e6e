"""The plan of a pick, without a plant, and what its mission refuses."""

import math
from pathlib import Path

import numpy as np
import pytest

import stepbus_scenarios
from stepbus.testing import Bench, scenario_config
from stepbus_kinematics import RobotModel
from stepbus_scenarios.pick.mission import Pick
from stepbus_scenarios.pick.picking import distance, motion, plan, spot_of, turn
from stepbus_scenarios.pick.scara import Scara, Spot
from stepbus_schemas import Description, GripperState, JointState, Poses, RunError, WiringError

MODEL = Path(stepbus_scenarios.__file__).parent / "pick/scara.urdf"
JOINTS = ["shoulder", "elbow", "lift", "wrist"]
ARM = Scara.read(MODEL, JOINTS, "base", "grasp")
LINKS = ["base", "cube_start_1"]
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
STATE = JointState(position=[-0.9, 1.8, 0.0, -0.9], velocity=[0.0] * 4)
OPEN = GripperState(width=0.08, force=0.0, holding=False)


def spot(x, y, yaw=0.0):
    return Spot(x=x, y=y, z=0.0, yaw=yaw)


def bench(joints=JOINTS, links=LINKS):
    """Return the mission of the scenario."""
    names = {"joint_state": joints, "poses": links, "gripper": []}
    descriptions = {port: Description(names=row) for port, row in names.items()}
    return Bench(Pick, scenario_config("pick", "mission"), descriptions)


def first_step(cube, orientation=UPRIGHT):
    """Return what the mission publishes at the first step, with the cube at a position."""
    poses = Poses(position=[(0.0, 0.0, 0.4), cube], orientation=[UPRIGHT, orientation])
    return bench().step(0, joint_state=STATE, gripper=OPEN, poses=poses)


def test_each_waypoint_has_the_tip_above_cube_or_goal_turned_as_it_is():
    cube, goal = spot(0.3, -0.2, 0.6), spot(0.2, 0.25, -0.3)
    waypoints = plan(ARM, cube, goal, grip_height=0.02, clearance=0.1)
    heights = {"above_cube": 0.12, "at_cube": 0.02, "above_goal": 0.12, "at_goal": 0.02}
    assert list(waypoints) == list(heights)
    for name, q in waypoints.items():
        place = cube if name.endswith("cube") else goal
        pose = RobotModel(MODEL, JOINTS).frame_pose(np.array(q), "grasp")
        assert pose.translation == pytest.approx([place.x, place.y, heights[name]])
        yaw = math.atan2(pose.rotation[1, 0], pose.rotation[0, 0])
        assert turn(spot(0, 0, yaw), place) < 1e-9


def test_a_cube_out_of_reach_is_named_with_the_reach_of_the_arm():
    with pytest.raises(
        RunError, match=r"cannot reach the cube at 0\.600.* 0\.050 to 0\.550 m and heights"
    ):
        plan(ARM, spot(0.6, 0.0), spot(0.3, 0.0), grip_height=0.02, clearance=0.1)


def test_a_motion_meets_its_ends_and_keeps_to_its_share_of_the_velocity_limits():
    start, end = (0.1, -0.7, 0.0, 1.0), (1.3, 0.4, -0.15, -2.0)
    path, dt = motion(ARM, start, end, 0.5), 1e-4
    assert (path.at(0.0), path.at(path.duration)) == (list(start), list(end))
    times = [k * dt for k in range(int(path.duration / dt))]
    shares = [
        max(abs(b - a) / dt / v for a, b, v in zip(*pair, ARM.velocity, strict=True))
        for pair in ((path.at(t), path.at(t + dt)) for t in times)
    ]
    assert max(shares) == pytest.approx(0.5, rel=1e-3)


def test_the_cube_is_seen_from_a_base_that_stands_turned_in_the_world():
    half = math.radians(90.0) / 2
    base = ((1.0, 2.0, 0.4), (0.0, 0.0, math.sin(half), math.cos(half)))
    seen = spot_of(base, ((0.8, 2.3, 0.5), UPRIGHT))
    assert (seen.x, seen.y, seen.z) == pytest.approx((0.3, 0.2, 0.1))
    assert seen.yaw == pytest.approx(-math.pi / 2)


def test_a_quarter_of_a_turn_is_none_and_a_cube_on_another_one_is_off():
    assert turn(spot(0, 0, 0.1), spot(0, 0, 0.1 + math.pi / 2)) < 1e-12
    assert turn(spot(0, 0, 0.2), spot(0, 0, -0.1)) == pytest.approx(0.3)
    assert distance(spot(0, 0), Spot(x=0.0, y=0.0, z=0.05, yaw=0.0)) == 0.05


def test_the_first_command_is_where_the_arm_is_and_the_gripper_open():
    published = first_step((0.35, -0.15, 0.4))
    assert published["command"].values == STATE.position
    assert published["gripper"].width == 0.08
    assert published["events"].text == "cube_start_1 stands at 0.350, -0.150 m, 0°"


def test_a_pose_that_is_not_finite_is_refused():
    with pytest.raises(RunError, match=r"pose of cube_start_1 or of the arm's base is not finite"):
        first_step((0.35, math.nan, 0.4))


def test_links_and_joints_that_the_plant_does_not_measure_are_all_named():
    with pytest.raises(WiringError) as caught:
        bench(joints=JOINTS[1:], links=["base", "cube_start_2"])
    assert str(caught.value).splitlines() == [
        "mission: input 'poses' has no link 'cube_start_1'; did you mean 'cube_start_2'?",
        "mission: input 'joint_state' has no joint 'shoulder'; known: elbow, lift, wrist",
    ]
