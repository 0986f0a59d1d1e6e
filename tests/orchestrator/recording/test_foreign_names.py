"""A recording with a name that no scenario may give is refused, whatever reads it."""

import json

import pytest
from support.messages.recordings import write

from stepbus_orchestrator import cli
from stepbus_orchestrator.errors import ExitCode, RecordingFailed
from stepbus_orchestrator.recording import McapFile, Recording, Tail
from stepbus_orchestrator.run.result import result_beside
from stepbus_schemas import JointCommand

NAMES = ["../../x", "/x", "", ".", "a/b", "a\nb", "\x1b[2J", "<b>", "a,b::c", "x" * 65]
READERS = [
    ("info",),
    ("report", "--out", "out.html"),
    ("plot", "--out", "out.png"),
    ("export", "--csv", "out"),
    ("diff", "run.mcap"),
    ("replay", "--participant", "plant"),
    ("rerun", "--out", "out"),
    ("branch", "--at", "1", "--out", "out"),
]


def with_participant(path, name, scenario_name="s"):
    """Write a recording whose scenario, and a participant in it, have these names."""
    file = McapFile(path)
    row = {"participant": "stepbus_plant:Plant"}
    scenario = {"name": scenario_name, "participants": {name: row}}
    file.attach("scenario.yaml", json.dumps(scenario).encode())
    file.close()
    return path


def with_port(path, topic):
    """Write a recording with a channel of a topic."""
    file = McapFile(path)
    file.add_channel(topic, "JointState/1", {})
    file.close()
    return path


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "make",
    [
        with_participant,
        lambda path, name: with_participant(path, "plant", name),
        lambda path, name: with_port(path, f"{name}/state"),
        lambda path, name: with_port(path, f"plant/{name}"),
    ],
    ids=["participant", "scenario", "source", "port"],
)
def test_a_name_that_no_scenario_accepts_is_refused(tmp_path, make, name):
    with pytest.raises(RecordingFailed, match="is not a valid name"):
        Recording(make(tmp_path / "run.mcap", name))


@pytest.mark.parametrize("length", [0, 200])
def test_a_recording_that_is_being_written_is_refused_for_its_names_too(tmp_path, length):
    port = ("JointCommand/1", ["joint1"], [JointCommand(mode="torque", values=[0.0])] * 9)
    path = write(tmp_path / "run.mcap", **{"../x": port})
    path.write_bytes(path.read_bytes()[: -length or None])
    tail = Tail(path)
    with pytest.raises(RecordingFailed, match="is not a valid name"):
        tail.poll()
    tail.close()


@pytest.mark.parametrize("words", READERS)
@pytest.mark.parametrize("make", [with_participant, with_port])
def test_every_command_refuses_such_a_recording_in_one_line(
    tmp_path, monkeypatch, capsys, make, words
):
    monkeypatch.chdir(tmp_path)
    make(tmp_path / "run.mcap", "../../\x1b[2Jx")
    assert cli.main([words[0], "run.mcap", *words[1:]]) == ExitCode.RECORDING
    error = capsys.readouterr().err
    assert error.startswith("stepbus: run.mcap is not from stepbus")
    assert "\x1b[2J" not in error
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_a_result_that_blames_a_path_is_none_of_the_recording(tmp_path):
    path = write(tmp_path / "run.mcap")
    result = dict.fromkeys(("outcome", "reason", "sha256", "folder", "transport", "scenario"), "")
    result |= dict.fromkeys(("exit_code", "at_step", "steps", "step_ns", "seed", "window"), 0)
    result |= dict.fromkeys(("start_s", "wall_s", "real_time_factor"), 0.0)
    for participant, is_taken in (("plant", True), ("../../x", False)):
        (tmp_path / "result.json").write_text(json.dumps(result | {"participant": participant}))
        assert (result_beside(Recording(path)) is not None) == is_taken
