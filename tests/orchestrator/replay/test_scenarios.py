"""Replays of scenarios that are not the simplest: rates, delays, bulk ports, early ends, cut logs."""

import io
import shutil

import pytest
from mcap.reader import make_reader
from support.runs.joints import PROGRAM, SCENARIO, fault, run_joints, write_scenario

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ScenarioError
from stepbus_orchestrator.recording import McapFile, recover
from stepbus_orchestrator.replay import replay
from stepbus_orchestrator.run.extensions.calls import Calls
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import CallRecord

SELDOM = """
name: seldom
step: 5ms
duration: 200ms
participants:
  camera:
    participant: seldom.py:Camera
    outputs: {picture: {type: Event/1, bulk: true}, note: Event/1}
  watcher:
    participant: seldom.py:Watcher
    inputs: {picture: camera.picture, note: {from: camera.note, delay: 2}}
    outputs: {seen: {type: Event/1, bulk: true}, note: Event/1}
"""

SELDOM_PROGRAM = """
import stepbus
from stepbus import Event

class Camera(stepbus.Participant):
    def update(self, step):
        found = {"picture": Event(level="info", text=f"{step.index}" * 50_000)}
        if step.index % 7 == 3:
            found["note"] = Event(level="info", text=f"look {step.index}")
        return found

class Watcher(stepbus.Participant):
    def update(self, step):
        if not step.is_new("note"):
            return None
        note = Event(level="info", text=step.read("note").text)
        return {"seen": step.read("picture"), "note": note}
"""


def recorded(folder, *overrides, text=SCENARIO):
    path = write_scenario(folder / "source", text)
    result = run(load(path, overrides), Options(out=folder / "out", host=InProcess()))
    assert result.exit_code == 0, result.reason
    return result.recording


@pytest.fixture(scope="module")
def joints(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("joints"), "duration=110ms")


@pytest.mark.parametrize(
    ("participant", "messages"), [("plant", 23), ("controller", 22), ("mission", 6)]
)
def test_slower_participants_are_equal(joints, participant, messages):
    result = replay(joints, participant)
    assert (result.equal, result.ports[0].equal, result.steps) == (True, messages, 22)


@pytest.fixture(scope="module")
def seldom(tmp_path_factory):
    folder = tmp_path_factory.mktemp("seldom")
    (folder / "source").mkdir()
    (folder / "source" / "seldom.py").write_text(SELDOM_PROGRAM)
    return recorded(folder, text=SELDOM)


@pytest.mark.parametrize("participant", ["camera", "watcher"])
def test_bulk_ports_delays_and_seldom_messages_are_replayed(seldom, participant):
    result = replay(seldom, participant)
    assert (result.equal, result.steps) == (True, 40)
    assert {port.topic: port.equal for port in result.ports} == {
        "camera": {"camera/picture": 40, "camera/note": 6},
        "watcher": {"watcher/seen": 5, "watcher/note": 5},
    }[participant]


def test_an_update_with_bulk_ports_is_the_recording_byte_for_byte(seldom, tmp_path):
    replay(seldom, "watcher", update=tmp_path / "new.mcap")
    assert (tmp_path / "new.mcap").read_bytes() == seldom.read_bytes()


@pytest.mark.parametrize("participant", ["plant", "controller"])
def test_an_update_has_the_calls_to_whoever_is_played_or_started(participant, tmp_path):
    scenario = load(write_scenario(tmp_path / "source"), ["duration=110ms"])
    calls = [
        CallRecord(step=step, participant="plant", method="put", args=[0, value])
        for step, value in ((5, 0.5), (12, -0.5))
    ]
    options = Options(out=tmp_path / "out", extensions=[Calls(calls)], host=InProcess())
    recording = run(scenario, options).recording
    replay(recording, participant, update=tmp_path / "new.mcap")
    assert (tmp_path / "new.mcap").read_bytes() == recording.read_bytes()


def test_a_run_that_its_controller_ended_is_equal(tmp_path):
    recording = recorded(tmp_path, fault("controller", "end", 9))
    result = replay(recording, "controller")
    assert (result.equal, result.steps) == (True, 10)


def test_ending_the_run_too_early_is_a_divergence(joints):
    result = replay(joints, "controller", set=[fault("controller", "end", 9)])
    found = result.divergence
    assert (found.step, found.topic, found.type) == (10, "controller/command", "missing")
    assert result.ports[0].missing == 12


def test_a_failed_run_is_replayed_up_to_its_failure(tmp_path):
    failed = run_joints(tmp_path, fault("controller", "raise", 9), in_process=True)
    assert failed.exit_code
    result = replay(failed.recording, "plant")
    assert (result.equal, result.ports[0].equal) == (True, 10)


@pytest.mark.parametrize("participant", ["plant", "controller", "mission"])
def test_a_recording_cut_off_is_replayed_up_to_its_end(joints, tmp_path, monkeypatch, participant):
    monkeypatch.setattr(McapFile, "chunk_bytes", 512)
    fine = recover(joints, tmp_path / "fine.mcap").target.read_bytes()
    cut = tmp_path / "cut.mcap"
    chunks = make_reader(io.BytesIO(fine)).get_summary().chunk_indexes
    cut.write_bytes(fine[: chunks[len(chunks) // 2].chunk_start_offset + 20])
    result = replay(cut, participant)
    assert result.equal
    assert 0 < result.steps < 22
    assert "the recording is damaged" in result.notes[0]


def test_another_program_that_computes_something_else_is_found(joints, tmp_path, monkeypatch):
    text = PROGRAM.read_text().replace("r - q for", "1.01 * (r - q) for")
    (tmp_path / "mine.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    found = replay(joints, "controller", program=["python", "mine.py", "controller"]).divergence
    assert (found.step, found.field, found.first, found.second) == (0, "values[1]", -0.5, -0.505)


def test_the_command_takes_another_program_at_its_end(joints, tmp_path, monkeypatch):
    shutil.copy(PROGRAM, tmp_path / "mine.py")
    monkeypatch.chdir(tmp_path)
    words = ["replay", str(joints), "--participant", "mission", "--json"]
    assert main([*words, "--exec", "python", "mine.py", "mission"]) == 0


def test_programs_of_the_peers_need_not_be_there(joints):
    missing = ["plant.exec=[no-such-program]"]
    assert replay(joints, "controller", set=missing).equal
    with pytest.raises(ScenarioError, match="no program 'no-such-program'"):
        replay(joints, "plant", set=missing)
