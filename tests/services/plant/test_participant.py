import math
import re

import pytest
from support.services.control import TWO_LINK, Stand, make_config
from support.tools import needs_pybullet

from stepbus_participant import CallError
from stepbus_plant import Plant
from stepbus_plant.commander import CommandError
from stepbus_plant.poses import PoseSensor
from stepbus_schemas import Description, JointCommand, WiringError


def config(takes="JointCommand/1", gives="JointState/1", every=1, **params):
    outputs = {"joint_state": gives, "copy": gives}
    params = {"world": "world.yaml", **params}
    return make_config(
        "plant", {"command": takes}, outputs, params=params, every=every, publishes="first"
    )


def started(names=(), **more):
    """Return a plant whose command inputs all speak of the same joints."""
    participant = Plant(config(**more))
    ports = dict.fromkeys(participant.config.inputs, Description(names=list(names)))
    participant.start(ports)
    return Stand(participant)


def torque(*values):
    return JointCommand(mode="torque", values=list(values))


def test_every_output_has_the_same_state_and_description():
    plant = Plant(config())
    assert {port: text.names for port, text in plant.describe().items()} == {
        "joint_state": ["joint1", "joint2"],
        "copy": ["joint1", "joint2"],
    }
    published = plant.output(None)
    assert published["joint_state"] == published["copy"]
    assert published["copy"].position == [0.0, 1.0]


def test_a_sender_without_names_speaks_of_all_joints_in_the_plants_order():
    stand = started(joints=["joint2", "joint1"])
    stand.update(0, command=torque(2.0, 1.0))
    assert stand.participant.plant.sense().effort == [2.0, 1.0]


def test_commands_are_mapped_by_the_senders_names():
    stand = started(["joint2", "joint1"])
    stand.update(0, command=torque(2.0, 1.0))
    assert stand.participant.plant.sense().effort == [1.0, 2.0]


def test_a_plant_that_fires_every_second_step_advances_by_two():
    slow, fast = started(every=2), started()
    slow.update(0, command=torque(1.0, 1.0))
    for step in range(2):
        fast.update(step, command=torque(1.0, 1.0))
    positions = [stand.participant.plant.sense().position for stand in (slow, fast)]
    assert positions[0] != pytest.approx([0.0, 1.0], abs=1e-6)
    assert positions[0] == pytest.approx(positions[1], abs=2e-3)


def test_a_command_that_cannot_be_carried_out_names_its_input():
    with pytest.raises(CommandError, match="'command': values has 1 entries"):
        started().update(0, command=torque(1.0))


def test_wrong_ports_and_wrong_parameters_are_listed_together():
    with pytest.raises(WiringError) as caught:
        Plant(config(takes="Event/1", gives="JointCommand/1", sense="all", jonts=[]))
    starts = [line.split(": ")[0] for line in str(caught.value).splitlines()]
    assert starts == [
        "participants.plant.inputs.command",
        "participants.plant.outputs.joint_state",
        "participants.plant.outputs.copy",
        "participants.plant.params.sense",
        "participants.plant.params.jonts",
    ]


def test_poses_are_published_at_their_own_period():
    stand = started(gives="Poses/1", poses_period="15ms")
    shown = []
    for step in range(7):
        shown.append("copy" in stand.participant.output(None))
        stand.update(step)
    assert shown == [True, False, False, True, False, False, True]


def test_an_emergency_stop_brakes_whatever_is_commanded_until_it_is_released():
    stand = started()
    stop = stand.participant.calls()["emergency_stop"].function
    stop()
    before = stand.participant.plant.sense().position
    for step in range(20):
        stand.update(step, command=torque(5.0, 5.0))
    state = stand.participant.plant.sense()
    assert state.position == pytest.approx(before, abs=0.01)
    stop(False)
    for step in range(20, 40):
        stand.update(step, command=torque(5.0, 5.0))
    assert stand.participant.plant.sense().effort == [5.0, 5.0]


def test_an_emergency_stop_is_in_a_checkpoint():
    stand = started()
    stand.participant.calls()["emergency_stop"].function()
    saved = stand.participant.save()
    other = started()
    other.participant.restore(saved)
    other.update(0, command=torque(5.0, 5.0))
    assert other.participant.plant.sense().effort != [5.0, 5.0]


def test_a_call_moves_a_body():
    participant = started().participant
    calls = participant.calls()
    assert calls["body_names"].function() == ["arm"]
    calls["move_body"].function("arm", 1, 2, 3.0, 0.5)
    sensor = PoseSensor(participant.plant.physics)
    pose = sensor.sense()
    assert pose.position[0] == pytest.approx((1, 2, 3))
    assert pose.orientation[0][3] == pytest.approx(math.cos(0.25))


def test_a_body_that_was_moved_is_where_it_was_put():
    participant, other = started().participant, started().participant
    participant.calls()["move_body"].function("arm", 1, 2, 3.0, 0.5)
    other.restore(participant.save())
    readings = [PoseSensor(one.plant.physics).sense() for one in (participant, other)]
    assert readings[0] == readings[1]


@needs_pybullet
def test_a_run_goes_on_without_a_checkpoint_where_its_file_cannot_be_written(monkeypatch, capfd):
    participant = started(engine="pybullet").participant
    module = type(participant.plant.physics.engine).__module__
    monkeypatch.setattr(f"{module}.scratch_folder", lambda: "/nowhere")
    assert participant.save() is None
    assert "no checkpoint at 0 s: [Errno 2]" in capfd.readouterr().err
    monkeypatch.undo()
    assert participant.save() is not None


@pytest.mark.parametrize(
    ("args", "text"),
    [
        (("arn", 0, 0, 0), "body 'arn' is unknown; did you mean 'arm'?"),
        (("arm", 0, "x", 0), "body arm: 'x' is not a finite number"),
        (("arm", 0, 0, math.nan), "body arm: nan is not a finite number"),
    ],
)
def test_a_body_that_cannot_be_moved_stays(args, text):
    with pytest.raises(CallError, match=re.escape(text)):
        started().participant.calls()["move_body"].function(*args)


WORLD = """
bodies:
  arm: {urdf: URDF, fixed_base: true, joint_defaults: {mode: velocity, brake: 4}}
"""


def test_a_checkpoint_while_the_joints_come_to_rest_goes_on_to_the_bit(tmp_path):
    world = tmp_path / "world.yaml"
    world.write_text(WORLD.replace("URDF", str(TWO_LINK / "two_link.urdf")))
    one, other = (started(world=str(world)) for _ in range(2))
    turn = JointCommand(mode="velocity", values=[2.0, -1.0])
    for step in range(100):
        one.update(step, command=turn)
    one.participant.emergency_stop()
    for step in range(100, 130):
        one.update(step)
    other.participant.restore(one.participant.save())
    speeds = []
    for step in range(130, 260):
        one.update(step)
        other.update(step)
        states = [stand.participant.plant.sense() for stand in (one, other)]
        assert states[0] == states[1]
        speeds.append(max(map(abs, states[0].velocity)))
    # It brakes from 2 rad/s with 4 rad/s² in 100 steps of 5 ms.
    assert speeds[0] > 1.0
    assert speeds[-1] < 1e-3
