"""A world without dynamics: what is commanded is what happens, at once."""

import math

import pytest
from support.services.devices import make_stand, write_base, write_gripper

from stepbus_schemas import BaseCommand, GripperCommand, JointCommand, WiringError

BASE = """
bodies:
  robot: {urdf: base.urdf, position: [0, 0, 0.1], joint_defaults: {mode: velocity}}
bases:
  base: {left: left, right: right, wheel_radius: 0.1, track: 0.5}
"""
GRIPPER = """
grippers:
  gripper: {left: left, right: right}
contacts:
  touch: {links: [left_pad, right_pad]}
bodies:
  gripper:
    urdf: gripper.urdf
    position: [0, 0, 0.1575]
    fixed_base: true
    joint_defaults: {mode: velocity}
    joints: {left: {position: 0.045}, right: {position: 0.045}}
  can: {urdf: can.urdf, position: [0, 0.004, 0.0575]}
"""


def place(stand, link, shown):
    row = stand.participant.describe()["truth"].names.index(link)
    return shown["truth"].position[row], shown["truth"].orientation[row]


def test_a_base_is_where_its_commands_lead_from_the_first_step_on(tmp_path):
    write_base(tmp_path)
    outputs = {"odometry": "BaseState/1", "truth": "Poses/1"}
    stand = make_stand(
        tmp_path, BASE, outputs, {"base": "BaseCommand/1"}, joints=["left", "right"], dynamics="off"
    )
    for step in range(100):
        stand.update(step, base=BaseCommand(vx=0.5, wz=0.4))
        shown = stand.participant.output(None)
        assert (shown["odometry"].vx, shown["odometry"].wz) == pytest.approx((0.5, 0.4))
    seconds = 100 * stand.participant.config.step_ns * 1e-9
    angle, radius = 0.4 * seconds, 0.5 / 0.4
    (x, y, _), (_, _, qz, qw) = place(stand, "chassis", shown)
    wanted = (radius * math.sin(angle), radius * (1 - math.cos(angle)))
    assert (x, y) == pytest.approx(wanted, abs=1e-6)
    assert 2 * math.atan2(qz, qw) == pytest.approx(angle, abs=1e-6)
    assert (shown["odometry"].x, shown["odometry"].y) == pytest.approx(wanted, abs=1e-6)
    stand.participant.close()


def test_a_gripper_centres_and_holds_what_it_closes_on_and_lets_it_go(tmp_path):
    write_gripper(tmp_path)
    inputs = {"gripper": "GripperCommand/1", "lift": "JointCommand/1"}
    outputs = {"gripper": "GripperState/1", "touch": "Contacts/1", "truth": "Poses/1"}
    stand = make_stand(tmp_path, GRIPPER, outputs, inputs, lift=["lift"], dynamics="off")
    step = 0

    def run(steps, **commands):
        nonlocal step
        for number in range(steps):
            stand.update(step, **(commands if number == 0 else {}))
            step += 1
        return stand.participant.output(None)

    held = run(200, gripper=GripperCommand(width=0.0, force=15.0))
    assert held["gripper"].holding
    assert held["gripper"].width == pytest.approx(0.066, abs=2.5e-3)
    assert set(held["touch"].force) == {15.0}
    before, _ = place(stand, "can", held)
    lifted = run(100, lift=JointCommand(mode="velocity", values=[0.1]))
    rise = place(stand, "can", lifted)[0][2] - before[2]
    assert rise == pytest.approx(0.1 * 100 * stand.participant.config.step_ns * 1e-9, rel=1e-6)
    run(1, lift=JointCommand(mode="velocity", values=[0.0]))
    opened = run(200, gripper=GripperCommand(width=0.09, force=15.0))
    assert not opened["gripper"].holding
    assert place(stand, "can", opened)[0][2] == pytest.approx(before[2] + rise)
    stand.participant.close()


def test_a_motor_of_mode_torque_needs_dynamics_and_is_named(tmp_path):
    write_base(tmp_path)
    world = BASE.replace("joint_defaults: {mode: velocity}", "joint_defaults: {mode: torque}")
    with pytest.raises(WiringError, match="left"):
        make_stand(tmp_path, world.partition("bases")[0], {}, {}, dynamics="off")


def test_the_plant_says_that_dynamics_are_off(tmp_path):
    write_base(tmp_path)
    stand = make_stand(
        tmp_path, BASE, {"state": "JointState/1", "events": "Event/1"}, {}, dynamics="off"
    )
    stand.update(0)
    assert "dynamics are off" in stand.participant.output(None)["events"].text
    assert set(stand.participant.describe()["state"].details["dynamics"]) == {"off"}
    stand.participant.close()
