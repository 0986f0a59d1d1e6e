"""What the plant answers between two steps, and what it lets nobody do."""

import msgspec
import pytest
from support.messages.recordings import messages
from support.runs.asker import Asker
from support.services.plant import body, make_plant

from stepbus_orchestrator.replay import replay
from stepbus_orchestrator.replay.rerun import Preparation
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.live_file import call
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_participant import CallError
from stepbus_schemas import JointCommand, JointState

POSITION = body("arm", "two_link", "{mode: position}")


def ask(plant, method, *args):
    return plant.calls.methods()[method].function(*args)


def test_every_joint_of_the_world_is_known_also_those_that_are_not_sensed(tmp_path):
    plant = make_plant(tmp_path, joints=["joint2"])
    assert ask(plant, "joint_names") == ["joint1", "joint2"]
    assert ask(plant, "joint_position", "joint1") == 0.0


def test_position_and_velocity_are_those_that_are_sensed(tmp_path):
    plant = make_plant(tmp_path)
    for _ in range(5):
        plant.advance()
    state = plant.sense()
    told = [ask(plant, f"joint_{what}", "joint2") for what in ("position", "velocity")]
    assert told == [state.position[1], state.velocity[1]]


def test_the_target_is_that_of_the_newest_command(tmp_path):
    plant = make_plant(tmp_path, POSITION)
    plant.commander("c", ["joint2", "joint1"]).apply(JointCommand(mode="position", values=[0.5, 1]))
    assert ask(plant, "joint_target", "joint2") == 0.5


def test_a_mode_without_targets_says_so(tmp_path):
    with pytest.raises(CallError, match="joint1 has mode torque, which has no"):
        ask(make_plant(tmp_path), "joint_target", "joint1")


def test_a_limit_that_there_is_not_is_none(tmp_path):
    plant = make_plant(tmp_path, body("w", "free_wheel"), body("arm", "two_link"))
    assert ask(plant, "joint_limits", "axle")["upper"] is None
    assert ask(plant, "joint_limits", "joint1") == {
        "lower": -6.2832,
        "upper": 6.2832,
        "velocity": 20.0,
        "effort": 50.0,
    }


@pytest.mark.parametrize(
    ("args", "sentence"),
    [
        (
            ("joint1", 7.0),
            r"joint joint1 cannot be teleported to 7; its limits are \[-6.2832, 6.2832\]",
        ),
        (("joint1", float("nan")), "joint joint1 cannot be teleported to nan"),
        (("joint1", "x"), "joint joint1: 'x' is not a number"),
        (("jont1", 0.0), "joint 'jont1' is unknown; did you mean 'joint1'"),
        ((3, 0.0), "joint 3 is unknown; known: joint1, joint2"),
    ],
)
def test_a_joint_is_not_put_where_it_cannot_be(tmp_path, args, sentence):
    plant = make_plant(tmp_path, POSITION)
    with pytest.raises(CallError, match=sentence):
        ask(plant, "set_joint_position", *args)
    assert plant.sense().position == [0.0, 0.0]


def test_a_joint_that_was_put_somewhere_is_held_there(tmp_path):
    plant = make_plant(tmp_path, POSITION)
    ask(plant, "set_joint_position", "joint2", 0.75)
    for _ in range(20):
        plant.advance()
    state = plant.sense()
    assert (state.position[1], state.target[1]) == (pytest.approx(0.75, abs=1e-3), 0.75)


@pytest.mark.slow
def test_a_run_in_which_a_joint_was_put_somewhere_is_run_again_and_replayed(tmp_path):
    pace = Pace(20)
    out = tmp_path / "out"
    words = [
        ("joint_names",),
        ("set_joint_position", "joint2", 0.25),
        ("set_joint_position", "j", 0),
    ]
    asker = Asker(pace, [lambda w=w: call(out, "plant", w[0], args=list(w[1:])) for w in words])
    result = run(load("two_link", ["duration=200ms"]), Options(out=out, extensions=[pace]), asker)
    asker.thread.join()
    assert [getattr(a, "value", a) for a in asker.answers[:2]] == [["joint1", "joint2"], None]
    assert asker.answers[2].startswith("set_joint_position: joint 'j'")
    rows = [d for t, _, _, d in messages(result.recording) if t == "plant/joint_state"]
    assert msgspec.msgpack.decode(rows[20], type=JointState).position[1] == 0.25
    assert Preparation(result.recording, tmp_path / "again").run().equal
    assert replay(result.recording, "plant").equal
