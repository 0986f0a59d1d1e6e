"""A recording is run again from nothing but itself."""

import os
import shutil
from pathlib import Path

import pytest
from support.runs.joints import run_joints

import stepbus_scenarios
from stepbus_orchestrator.errors import OutputExists, RecordingFailed
from stepbus_orchestrator.recording import McapFile, Recording, layout
from stepbus_orchestrator.replay.rerun import Preparation
from stepbus_orchestrator.replay.sources import Sources
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.result import own_versions
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load


def write_log(path, scenario="name: x", files=None, versions=None):
    """Write a recording without messages."""
    file = McapFile(path)
    if scenario is not None:
        file.attach("scenario.yaml", scenario.encode())
    for name, content in (files or {}).items():
        file.attach(f"files/{name}", content)
    for name, content in (versions or {}).items():
        file.add_metadata(f"versions/{name}", content)
    file.close()
    return path


@pytest.fixture(scope="module")
def again(two_link_recording, tmp_path_factory):
    """Run the recorded two_link again, in other circumstances."""
    out = tmp_path_factory.mktemp("again") / "run"
    circumstances = ["window=2", "batch=1", "bus.transport=tcp"]
    return Preparation(two_link_recording, out, circumstances).run()


def test_a_recording_run_again_is_equal_to_the_byte(again, two_link_recording):
    assert (again.result.exit_code, again.equal, list(again.notes)) == (0, True, [])
    assert again.result.recording.read_bytes() == two_link_recording.read_bytes()


def test_the_scenario_and_its_files_are_unpacked_beside_the_new_run(again):
    source = again.result.recording.parent / "source"
    names = {path.name for path in source.iterdir()}
    assert names >= {"scenario.yaml", "world.yaml", "two_link.urdf"}


def test_the_log_alone_is_enough(tmp_path):
    recorded = run_joints(tmp_path, "duration=50ms", in_process=True)
    (tmp_path / "source").rename(tmp_path / "elsewhere")
    assert Preparation(recorded.recording, tmp_path / "again").run().equal


def test_a_program_of_the_log_can_be_executed_again(tmp_path):
    files = {"bin/start.sh": b"#!/bin/sh\n", "world.yaml": b"{}"}
    log = write_log(tmp_path / "run.mcap", files=files)
    Sources.of(Recording(log)).unpack(tmp_path / "source")
    assert os.access(tmp_path / "source" / "bin" / "start.sh", os.X_OK)
    assert not os.access(tmp_path / "source" / "world.yaml", os.X_OK)


def test_a_cut_recording_runs_again_and_the_damage_is_noted(tmp_path):
    recorded = run_joints(tmp_path, "duration=50ms", in_process=True).recording
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[:-20])
    again = Preparation(cut, tmp_path / "again").run()
    assert again.notes[0].startswith("the recording is damaged: the footer")
    assert (
        again.notes[: len(again.flaws)] == [f"the recording {flaw}" for flaw in again.flaws] != []
    )
    assert again.result.recording.read_bytes() == recorded.read_bytes()


def test_other_versions_and_another_processor_are_noted(tmp_path):
    recorded = run_joints(tmp_path, "duration=50ms", in_process=True).recording
    opened = Recording(recorded)
    sources = Sources.of(opened)
    versions = {
        **layout.versions_of(opened.metadata),
        "orchestrator": {**own_versions(), "cpu": "Z80", "mcap": "0.1"},
    }
    old = write_log(tmp_path / "old.mcap", sources.scenario.decode(), sources.files, versions)
    notes = Preparation(old, tmp_path / "again").notes
    now = own_versions()
    assert f"with cpu Z80, here it is {now['cpu']}" in " ".join(notes)
    assert f"with mcap 0.1, here it is {now['mcap']}" in " ".join(notes)


@pytest.mark.slow
def test_other_versions_of_a_participant_are_noted(two_link_recording, tmp_path):
    opened = Recording(two_link_recording)
    sources = Sources.of(opened)
    plant = dict.fromkeys(layout.versions_of(opened.metadata)["plant"], "0.1")
    versions = {**layout.versions_of(opened.metadata), "plant": plant}
    old = write_log(tmp_path / "old.mcap", sources.scenario.decode(), sources.files, versions)
    again = Preparation(old, tmp_path / "again", ["duration=20ms"]).run()
    assert len(plant) > 0
    assert [note.startswith("plant ran with") for note in again.notes].count(True) == len(plant)


@pytest.mark.parametrize("name", ["..", "../a/../../evil", "/etc/evil", "a/../../evil", ""])
def test_a_file_that_leads_out_of_its_folder_is_refused(tmp_path, name):
    log = write_log(tmp_path / "run.mcap", files={name: b"print()"})
    with pytest.raises(RecordingFailed, match="points outside its folder"):
        Preparation(log, tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_a_recording_without_a_scenario_is_refused(tmp_path):
    log = write_log(tmp_path / "timing.mcap", scenario=None)
    with pytest.raises(RecordingFailed, match=r"contains no scenario\.yaml"):
        Preparation(log, tmp_path / "out")


def test_a_folder_that_holds_a_run_is_not_touched(two_link_recording):
    with pytest.raises(OutputExists, match="choose another --out"):
        Preparation(two_link_recording, two_link_recording.parent)
    assert not (two_link_recording.parent / "source").exists()


def test_a_recording_with_shared_models_is_run_again_from_itself_alone(tmp_path):
    shipped = Path(stepbus_scenarios.__file__).parent / "two_link"
    (tmp_path / "models").mkdir()
    shutil.copy(shipped / "two_link.urdf", tmp_path / "models" / "arm.urdf")
    shutil.copytree(shipped, tmp_path / "arm")
    for name, old in (("world.yaml", "two_link.urdf"), ("scenario.yaml", "model: two_link.urdf")):
        path = tmp_path / "arm" / name
        path.write_text(path.read_text().replace(old, old.replace("two_link", "../models/arm")))
    scenario = load(tmp_path / "arm", ["duration=50ms"])
    first = run(scenario, Options(out=tmp_path / "first", host=InProcess()))
    shutil.rmtree(tmp_path / "models")
    shutil.rmtree(tmp_path / "arm")
    assert Preparation(first.recording, tmp_path / "again").run().equal


def test_an_open_end_is_told_with_the_number_of_recorded_steps(tmp_path):
    recording = run_joints(tmp_path, "duration=50ms", in_process=True).recording
    notes = Preparation(recording, tmp_path / "again", ["duration=null"]).notes
    assert "the recording has 10 steps" in " ".join(notes)
