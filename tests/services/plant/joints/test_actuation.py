import numpy as np
import pytest
from support.services.plant import MS, body, drive, make_plant, swing

from stepbus_schemas import JointCommand


def wheel(tmp_path, settings="{}", **plant):
    return make_plant(tmp_path, body("w", "wheel", settings), step_ns=MS, **plant)


@pytest.mark.parametrize("actuation", ["direct", "velocity_force"])
def test_a_torque_turns_a_wheel_as_newton_says(tmp_path, actuation):
    plant = wheel(tmp_path, actuation=actuation)
    states = drive(plant, JointCommand(mode="torque", values=[2.0]), 100)
    assert states[-1, 1, 0] == pytest.approx(2.0 / 0.5 * 0.1, rel=1e-9)


def test_direct_torque_and_velocity_force_agree_within_1e_9_rad_over_2000_steps(tmp_path):
    runs = [
        swing(make_plant(tmp_path, actuation=actuation), 2000)
        for actuation in ("direct", "velocity_force")
    ]
    assert np.ptp(runs[0][:, 0]) > 1.0
    assert np.abs(runs[0][:, 0] - runs[1][:, 0]).max() < 1e-9


@pytest.mark.parametrize("actuation", ["direct", "velocity_force"])
def test_effort_shows_the_torque_of_the_last_step(tmp_path, actuation):
    plant = wheel(tmp_path, actuation=actuation)
    assert plant.sense().effort == [0.0]
    states = drive(plant, JointCommand(mode="torque", values=[-2.0]), 1)
    assert states[0, 2, 0] == pytest.approx(-2.0, abs=1e-9)


@pytest.mark.parametrize("actuation", ["direct", "velocity_force"])
@pytest.mark.parametrize("sign", [-1, 1])
def test_torque_saturates_at_the_joints_limit(tmp_path, actuation, sign):
    plant = wheel(tmp_path, actuation=actuation)
    states = drive(plant, JointCommand(mode="torque", values=[sign * 500.0]), 1)
    assert states[0, 2, 0] == pytest.approx(sign * 10.0)


def test_the_world_overrides_the_limit_of_the_urdf(tmp_path):
    plant = wheel(tmp_path, "{effort: 3}")
    states = drive(plant, JointCommand(mode="torque", values=[500.0]), 1)
    assert states[0, 2, 0] == 3.0
    assert plant.joints.description.limits["effort"] == [3.0]


def test_mode_velocity_holds_a_velocity(tmp_path):
    plant = wheel(tmp_path, "{mode: velocity}")
    states = drive(plant, JointCommand(mode="velocity", values=[0.7]), 500)
    assert states[-1, 1, 0] == pytest.approx(0.7, rel=1e-6)


def test_mode_velocity_saturates_at_the_velocity_limit(tmp_path):
    plant = wheel(tmp_path, "{mode: velocity, max_velocity: 0.5}")
    states = drive(plant, JointCommand(mode="velocity", values=[-40.0]), 500)
    assert states[-1, 1, 0] == pytest.approx(-0.5, rel=1e-6)


def test_mode_velocity_accelerates_with_no_more_than_the_commands_effort_limit(tmp_path):
    plant = wheel(tmp_path, "{mode: velocity}")
    states = drive(plant, JointCommand(mode="velocity", values=[3.0], effort_limit=[2.0]), 50)
    assert states[-1, 1, 0] == pytest.approx(2.0 / 0.5 * 0.05, rel=1e-6)


def test_an_effort_limit_above_the_joints_own_gives_no_more_torque(tmp_path):
    plant = wheel(tmp_path, "{mode: velocity, effort: 2}")
    states = drive(plant, JointCommand(mode="velocity", values=[3.0], effort_limit=[99.0]), 50)
    assert states[-1, 1, 0] == pytest.approx(2.0 / 0.5 * 0.05, rel=1e-6)


def test_mode_position_reaches_its_target_and_reports_it(tmp_path):
    plant = wheel(tmp_path, "{mode: position}")
    states = drive(plant, JointCommand(mode="position", values=[0.6]), 2000)
    assert states[-1, 0, 0] == pytest.approx(0.6, abs=1e-4)
    assert plant.sense().target == [0.6]


def test_mode_position_stays_under_the_velocity_limit(tmp_path):
    plant = wheel(tmp_path, "{mode: position, max_velocity: 0.2}")
    states = drive(plant, JointCommand(mode="position", values=[0.6]), 500)
    assert np.abs(states[:, 1, 0]).max() == pytest.approx(0.2, rel=1e-3)


def test_a_position_target_beyond_a_stop_ends_at_the_stop(tmp_path):
    plant = wheel(tmp_path, "{mode: position}")
    drive(plant, JointCommand(mode="position", values=[9.0]), 1)
    assert plant.sense().target == [1.0]


def lag(folder, feed_forward):
    plant = wheel(folder, "{mode: position}")
    commander = plant.commander("command", plant.names)
    for step in range(500):
        ahead = [1.0] if feed_forward else None
        target = [0.001 * (step + 1)]
        commander.apply(JointCommand(mode="position", values=target, velocity=ahead))
        plant.advance()
    return plant.sense().target[0] - plant.sense().position[0]


def test_feed_forward_velocity_takes_the_lag_out_of_mode_position(tmp_path):
    assert lag(tmp_path, feed_forward=False) > 0.005
    assert abs(lag(tmp_path, feed_forward=True)) < 0.001


def test_only_a_plant_all_in_mode_position_has_targets(tmp_path):
    settings = "{joint1: {mode: position}}"
    plant = make_plant(tmp_path, body("arm", "two_link", joints=settings))
    assert plant.sense().target is None


def test_teleporting_puts_a_joint_there_at_rest_at_once(tmp_path):
    plant = make_plant(tmp_path)
    plant.commander("c", ["joint2"]).apply(JointCommand(mode="teleport", values=[-0.4]))
    assert plant.sense().position == [0.0, -0.4]
    assert plant.sense().velocity == [0.0, 0.0]


def test_teleporting_may_give_a_velocity(tmp_path):
    plant = wheel(tmp_path)
    command = JointCommand(mode="teleport", values=[0.1], velocity=[2.0])
    assert drive(plant, command, 10)[-1, 0, 0] == pytest.approx(0.1 + 2.0 * 0.01)


def test_no_motor_drives_a_joint_of_mode_teleport(tmp_path):
    plant = wheel(tmp_path, "{mode: teleport, velocity: 2}")
    for _ in range(100):
        plant.advance()
    assert plant.sense().velocity == pytest.approx([2.0])


def test_a_joint_of_mode_torque_swings_on_from_where_it_was_teleported(tmp_path):
    plant = make_plant(tmp_path)
    states = drive(plant, JointCommand(mode="teleport", values=[0.5, 0.0]), 20)
    assert states[0, 0, 0] == pytest.approx(0.5, abs=1e-3)
    assert states[-1, 0, 0] > 0.52


def test_a_joint_of_mode_position_holds_where_it_was_teleported(tmp_path):
    plant = wheel(tmp_path, "{mode: position}")
    states = drive(plant, JointCommand(mode="teleport", values=[0.5]), 200)
    assert states[-1, 0, 0] == pytest.approx(0.5, abs=1e-9)
    assert plant.sense().target == [0.5]


@pytest.mark.parametrize("mode", ["velocity", "position"])
def test_a_joint_that_was_never_commanded_holds_where_it_is(tmp_path, mode):
    plant = make_plant(tmp_path, body("arm", "two_link", f"{{mode: {mode}, position: 0.2}}"))
    for _ in range(100):
        plant.advance()
    assert plant.sense().position == pytest.approx([0.2, 0.2], abs=2e-3)


def test_a_joint_of_mode_torque_that_was_never_commanded_swings_freely(tmp_path):
    plant = make_plant(tmp_path)
    for _ in range(50):
        plant.advance()
    assert plant.sense().position[0] > 0.1


def test_a_command_holds_until_the_next(tmp_path):
    plant = wheel(tmp_path)
    commander = plant.commander("command", plant.names)
    for value in (4.0, 0.0):
        commander.apply(JointCommand(mode="torque", values=[value]))
        for _ in range(10):
            plant.advance()
    assert plant.sense().velocity == pytest.approx([4.0 / 0.5 * 0.01])
