import math

import numpy as np
import pytest
from support.services.plant import body, digest, make_plant, swing, torques

from stepbus_plant.commander import CommandError
from stepbus_schemas import JointCommand, WiringError


def command(*values, mode="torque", **more):
    return JointCommand(mode=mode, values=list(values), **more)


def refuse(plant, order, match):
    commander = plant.commander("command", plant.names)
    with pytest.raises(CommandError, match=match):
        commander.apply(order)


@pytest.mark.parametrize(
    ("order", "mistake"),
    [
        (
            command(1.0, 2.0, mode="position"),
            "joint joint1 has mode torque, .* has mode position",
        ),
        (command(1.0), r"values has 1 entries for 2 joints \(joint1, joint2\)"),
        (command(1.0, 2.0, 3.0), "values has 3 entries for 2 joints"),
        (command(1.0, math.nan), "values of joint joint2 is nan"),
        (command(-math.inf, math.inf), "values of joint joint1 is -inf"),
        (
            command(0.0, 7.0, mode="teleport"),
            r"joint joint2 cannot be teleported to 7; its limits are",
        ),
        (command(0.0, math.nan, mode="teleport"), "values of joint joint2 is nan"),
    ],
)
def test_a_command_that_cannot_be_carried_out_is_refused(tmp_path, order, mistake):
    refuse(make_plant(tmp_path), order, f"^input 'command': {mistake}")


@pytest.mark.parametrize(
    ("more", "mistake"),
    [
        ({"effort_limit": [1.0]}, "effort_limit has 1 entries for 2 joints"),
        ({"velocity": [math.nan, 0.0]}, "velocity of joint joint1 is nan"),
    ],
)
def test_the_other_vectors_of_a_command_are_checked_too(tmp_path, more, mistake):
    plant = make_plant(tmp_path, body("arm", "two_link", "{mode: position}"))
    refuse(plant, command(0.0, 0.0, mode="position", **more), mistake)


def test_all_unknown_and_double_names_are_listed(tmp_path):
    with pytest.raises(WiringError) as caught:
        make_plant(tmp_path).commander("command", ["joint1", "joint3", "elbow", "joint1"])
    assert [line.split(";")[0] for line in str(caught.value).splitlines()] == [
        "joint 'joint3' is unknown",
        "joint 'elbow' is unknown",
        "joint 'joint1' is listed twice",
    ]


@pytest.mark.parametrize("actuation", ["direct", "velocity_force"])
def test_two_inputs_share_one_body(tmp_path, actuation):
    plant = make_plant(tmp_path, actuation=actuation)
    left, right = plant.commander("left", ["joint2"]), plant.commander("right", ["joint1"])
    rows = []
    for step in range(300):
        tau = torques(step)
        left.apply(command(tau[1]))
        right.apply(command(tau[0]))
        plant.advance()
        state = plant.sense()
        rows.append([state.position, state.velocity, state.effort])
    assert digest(np.array(rows)) == digest(swing(make_plant(tmp_path, actuation=actuation), 300))


def test_a_command_of_some_joints_leaves_the_targets_of_the_others(tmp_path):
    plant = make_plant(tmp_path, body("arm", "two_link", "{mode: position}"))
    first, second = plant.commander("a", ["joint1"]), plant.commander("b", ["joint2"])
    first.apply(command(0.5, mode="position"))
    second.apply(command(-0.5, mode="position"))
    assert plant.sense().target == [0.5, -0.5]


def test_a_joint_is_driven_by_one_input_only(tmp_path):
    plant = make_plant(tmp_path)
    first, second = (plant.commander(port, plant.names) for port in ("first", "second"))
    first.apply(command(1.0, 1.0))
    with pytest.raises(CommandError, match=r"joint1 is already driven by .*'first'"):
        second.apply(command(1.0, 1.0))


def test_another_input_may_teleport_a_driven_joint(tmp_path):
    plant = make_plant(tmp_path)
    first, second = (plant.commander(port, plant.names) for port in ("first", "second"))
    first.apply(command(1.0, 1.0))
    second.apply(command(0.3, 0.4, mode="teleport"))
    assert plant.sense().position == [0.3, 0.4]


def test_joints_of_two_bodies_are_commanded_and_sensed_in_any_order(tmp_path):
    bodies = [body("a", "wheel"), body("b", "free_wheel", "{effort: 10}")]
    plant = make_plant(tmp_path, *bodies, joints=["b/axle", "a/axle"])
    plant.commander("c", ["a/axle", "b/axle"]).apply(command(1.0, 2.0))
    plant.advance()
    assert plant.sense().effort == [2.0, 1.0]
    assert plant.sense().velocity == pytest.approx([2.0 / 0.5 * 0.005, 1.0 / 0.5 * 0.005])


def test_joints_of_one_body_may_have_different_modes(tmp_path):
    joints = "{joint1: {mode: position}, joint2: {mode: torque}}"
    plant = make_plant(tmp_path, body("arm", "two_link", joints=joints))
    plant.commander("shoulder", ["joint1"]).apply(command(0.0, mode="position"))
    plant.commander("elbow", ["joint2"]).apply(command(3.0))
    plant.advance()
    assert plant.sense().effort[1] == 3.0
    assert plant.sense().position[0] == pytest.approx(0.0, abs=1e-3)


def test_the_order_of_names_in_a_command_changes_nothing(tmp_path):
    straight = swing(make_plant(tmp_path), 300)
    permuted = swing(make_plant(tmp_path), 300, ("joint2", "joint1"))
    assert digest(straight) == digest(permuted)
