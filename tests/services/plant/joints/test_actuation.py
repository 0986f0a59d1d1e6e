import pytest
from support.services.plant import MS, body, drive, make_plant

from stepbus_schemas import JointCommand


def wheel(tmp_path, settings="{}", **plant):
    return make_plant(tmp_path, body("w", "wheel", settings), step_ns=MS, **plant)


def test_mode_velocity_saturates_at_the_velocity_limit(tmp_path):
    plant = wheel(tmp_path, "{mode: velocity, max_velocity: 0.5}")
    states = drive(plant, JointCommand(mode="velocity", values=[-40.0]), 500)
    assert states[-1, 1, 0] == pytest.approx(-0.5, rel=1e-6)


@pytest.mark.parametrize(("settings", "limit"), [("", 2.0), (", effort: 2", 99.0)])
def test_mode_velocity_accelerates_with_no_more_than_either_effort_limit(tmp_path, settings, limit):
    plant = wheel(tmp_path, f"{{mode: velocity{settings}}}")
    states = drive(plant, JointCommand(mode="velocity", values=[3.0], effort_limit=[limit]), 50)
    assert states[-1, 1, 0] == pytest.approx(2.0 / 0.5 * 0.05, rel=1e-6)


def test_a_position_target_beyond_a_stop_ends_at_the_stop(tmp_path):
    plant = wheel(tmp_path, "{mode: position}")
    drive(plant, JointCommand(mode="position", values=[9.0]), 1)
    assert plant.sense().target == [1.0]


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


@pytest.mark.parametrize("mode", ["velocity", "position"])
def test_a_joint_that_was_never_commanded_holds_where_it_is(tmp_path, mode):
    plant = make_plant(tmp_path, body("arm", "two_link", f"{{mode: {mode}, position: 0.2}}"))
    for _ in range(100):
        plant.advance()
    assert plant.sense().position == pytest.approx([0.2, 0.2], abs=2e-3)
