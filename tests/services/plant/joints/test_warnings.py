"""A command that cannot take effect is told: once per joint and cause, with its numbers."""

import math

import numpy as np
import pytest
from support.services.plant import body, make_plant

from stepbus_schemas import JointCommand, WiringError

POSITION = body("arm", "two_link", "{mode: position}")


def told(plant, *commands):
    commander = plant.commander("command", plant.names)
    for command in commands:
        commander.apply(command)
    return plant.warnings.pending


def position(*values, **more):
    return JointCommand(mode="position", values=list(values), **more)


@pytest.mark.parametrize(
    ("settings", "command", "sentence"),
    [
        ("{mode: position}", position(7.0, 0.0), "joint joint1: target 7 rad is beyond its stop at 6.2832; limited to it"),
        ("{mode: position}", position(-90.0, 0.0), "joint joint1: target -90 rad is beyond its stop at -6.2832; limited to it"),
        ("{mode: position, effort: 0}", position(0.0, 0.0), "joint joint1: has an effort limit of 0 N·m; nothing moves it"),
        ("{mode: position}", position(0.0, 0.0, effort_limit=[0.0, 1.0]), "joint joint1: has an effort limit of 0 N·m; nothing moves it"),
        ("{motor: false}", position(0.0, 0.0), "joint joint1: has no motor (world file: motor: false); it swings freely"),
        ("{}", JointCommand(mode="torque", values=[60.0, 0.0]), "joint joint1: 60 N·m exceeds its limit of 50; limited to it"),
        ("{mode: velocity}", JointCommand(mode="velocity", values=[30.0, 0.0]), "joint joint1: 30 rad/s exceeds its limit of 20; limited to it"),
    ],
)  # fmt: skip
def test_what_has_no_effect_is_told_with_joint_and_numbers(tmp_path, settings, command, sentence):
    plant = make_plant(tmp_path, body("arm", "two_link", settings))
    assert told(plant, command)[0] == sentence


def test_a_target_that_moves_faster_than_its_joint_is_told(tmp_path):
    command = position(0.0, 0.0, velocity=[20.0, -20.5])
    (line,) = told(make_plant(tmp_path, POSITION), command)
    assert line.startswith("joint joint2: its target moves at -20.5")


def test_a_cause_is_told_once_per_joint(tmp_path):
    plant = make_plant(tmp_path, POSITION)
    lines = told(plant, position(7.0, 0.0), position(8.0, 0.0), position(7.0, 7.0))
    assert [line.split(":")[0] for line in lines] == ["joint joint1", "joint joint2"]


def test_a_joint_without_a_motor_swings_and_is_called_passive(tmp_path):
    plant = make_plant(tmp_path, body("arm", "two_link", "{motor: false}"))
    told(plant, position(0.0, 0.0))
    for _ in range(20):
        plant.advance()
    assert abs(plant.sense().position[0]) > 0.01
    assert plant.joints.description.details["mode"] == ["passive", "passive"]


def test_a_fixed_joint_cannot_be_commanded(tmp_path):
    text = make_plant(tmp_path)
    text.physics.fixed.add("flange")
    with pytest.raises(WiringError, match="joint 'flange' is fixed in its model"):
        text.commander("command", ["flange"])


def test_params_override_the_effort_of_a_joint(tmp_path):
    plant = make_plant(tmp_path, effort={"joint2": 0.5})
    assert plant.joints.description.limits["effort"] == [50.0, 0.5]


def test_a_target_moves_on_at_its_velocity_until_the_next_command_is_due(tmp_path):
    plant = make_plant(tmp_path, POSITION, world="substeps: 5")
    plant.commander("command", plant.names, 10_000_000).apply(
        position(0.1, 0.0, velocity=[1.0, 0.0])
    )
    targets = []
    for _ in range(4):
        targets.append(plant.sense().target[0])
        plant.advance()
    assert targets == pytest.approx([0.1, 0.105, 0.11, 0.11])


def test_a_moving_target_stops_at_the_stop(tmp_path):
    plant = make_plant(tmp_path, POSITION)
    plant.commander("command", plant.names).apply(position(6.28, 0.0, velocity=[9.0, 0.0]))
    plant.advance()
    assert plant.sense().target[0] == 6.2832


def sine_error(plant, *, ahead):
    """Return the largest error of a sine of 1 Hz that is commanded every 50 ms [rad]."""
    commander = plant.commander("command", plant.names)
    error = []
    for step in range(40):
        now, after = (0.2 * math.sin(2 * math.pi * 0.05 * k) for k in (step, step + 1))
        error.append(plant.sense().position[0] - now)
        velocity = [(after - now) / 0.05, 0.0] if ahead else None
        commander.apply(position(now, 0.0, velocity=velocity))
        plant.advance()
    return np.abs(error[20:]).max()


def test_feed_forward_takes_the_lag_away(tmp_path):
    def plant():
        return make_plant(tmp_path, POSITION, world="substeps: 10", step_ns=50_000_000)

    assert sine_error(plant(), ahead=True) < 0.005
    assert sine_error(plant(), ahead=False) > 0.05
