"""The controller of goals as a participant: what it wants of a scenario, and what it publishes."""

import numpy as np
import pytest
from support.services.arm import JOINTS, write_arm
from support.services.control import Stand, make_config

from stepbus_schemas import Description, Goal, JointState, WiringError
from stepbus_store.motion.arm.arm_controller import ArmController

MS = 1_000_000


def config(folder, **params):
    write_arm(folder)
    inputs = {"joint_state": "JointState/1", "goal": "Goal/1"}
    outputs = {
        "command": "JointCommand/1",
        "goal_status": "GoalStatus/1",
        "status": "ControllerStatus/1",
    }
    params = {"model": "arm.urdf", "joints": list(JOINTS), **params}
    return make_config("controller", inputs, outputs, folder, params=params, step_ns=50 * MS)


def make_arm(given, effort=100.0, names=JOINTS[::-1]):
    """Return a started controller; names: the plant's own joint order."""
    arm = ArmController(given)
    state = Description(names=list(names), limits={"effort": [effort] * len(names)})
    arm.start({"joint_state": state, "goal": Description()})
    return Stand(arm)


def test_each_target_is_reached_by_its_feed_forward_velocity_at_the_next(tmp_path):
    arm = make_arm(config(tmp_path))
    goal = Goal(id=0, type="move_joints", joints=["one"], values=[1.0])
    state = JointState(position=[0.1, 0.2, 0.3], velocity=[0.0] * 3)
    rows = [arm.update(k, joint_state=state, goal=goal)["command"] for k in range(30)]
    values, velocity = (np.array([getattr(row, f) for row in rows]) for f in ("values", "velocity"))
    assert values[0] == pytest.approx([0.3, 0.2, 0.1])
    assert values[:-1] + velocity[:-1] * 0.05 == pytest.approx(values[1:])
    assert np.abs(velocity).max() <= 0.8 * 2 + 1e-9


def test_poses_are_judged_by_the_effort_limits_that_the_plant_describes(tmp_path):
    arm = make_arm(config(tmp_path), effort=20.0)
    state = JointState(position=[0.0] * 3, velocity=[0.0] * 3)
    goal = Goal(id=0, type="move_joints", joints=list(JOINTS), values=[0.1, 0.1, 0.1])
    status = arm.update(0, joint_state=state, goal=goal)["goal_status"]
    assert (status.state, status.cause) == ("failed", "not_holdable")
    assert "one needs 43.5 N·m and has 20.0 N·m" in status.text


def test_nothing_is_commanded_before_the_joints_are_measured(tmp_path):
    assert make_arm(config(tmp_path)).update(0) == {}


def test_a_joint_that_the_plant_lacks_is_named(tmp_path):
    with pytest.raises(WiringError, match="input 'joint_state' has no joint 'two'"):
        make_arm(config(tmp_path), names=["three", "one"])


def test_all_mistakes_of_a_scenario_are_listed_at_once(tmp_path):
    with pytest.raises(WiringError) as caught:
        ArmController(config(tmp_path, settle_steps=1.5, acceleration_limit=0, velocty_limit=1,
                             not_holdable="maybe"))  # fmt: skip
    text = str(caught.value)
    for part in ("settle_steps: must be an integer of at least 1, not 1.5", "acceleration_limit: must be a number above 0",
                 "not_holdable: must be refuse or try, not 'maybe'",
                 "unknown key 'velocty_limit'; did you mean 'velocity_limit'"):  # fmt: skip
        assert part in text


def test_a_prefix_names_one_of_two_robots_of_one_urdf(tmp_path):
    names = [f"{side}/{joint}" for joint in JOINTS for side in ("left", "right")]
    arm = make_arm(config(tmp_path, prefix="right/"), names=names)
    described = arm.participant.describe()
    assert described["command"].names == [f"right/{joint}" for joint in JOINTS]
    goal = Goal(id=0, type="move_joints", joints=["one"], values=[1.0])
    state = JointState(position=[9.0, 0.1, 9.0, 0.2, 9.0, 0.3], velocity=[0.0] * 6)
    command = arm.update(0, joint_state=state, goal=goal)["command"]
    assert command.values == pytest.approx([0.1, 0.2, 0.3])
