"""A recording is read lazily, as arrays, also where it is cut off."""

import math
import os
import tracemalloc

import numpy as np
import pytest
from mcap.writer import CompressionType
from support.messages.recordings import chunks, rewrite, write

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import McapFile, Recording, recover
from stepbus_orchestrator.recording.layout import channel_metadata
from stepbus_schemas import Description, Event, Image, JointState, WiringError
from stepbus_tools.signals import read_tracking

PIXELS = {"width": 200, "height": 200, "focal": (1.0, 1.0), "centre": (0.0, 0.0)}
IMAGE = Image(encoding="rgb8", data=os.urandom(120_000), **PIXELS)


@pytest.fixture
def path(tmp_path):
    """Return a recording of 6 steps: joints, images, and an event at step 2."""
    joints = [JointState(position=[0.1 * n, 1.0]) for n in range(6)]
    limits = Description(names=["a", "b"], limits={"lower": [-math.inf, 0.0]}, units={"x": "m"})
    return write(
        tmp_path / "run.mcap",
        joints=("JointState/1", limits, joints),
        camera=("Image/1", [], [IMAGE] * 6),
        events=("Event/1", [], [None, None, Event(level="info", text="hi"), None]),
    )


@pytest.fixture
def recording(path):
    with Recording(path) as recording:
        yield recording


def test_a_port_has_arrays_of_messages_and_joints_steps_times_names_and_units(recording):
    joints = recording["plant/joints"]
    assert joints.position.shape == (6, 2)
    assert joints.position[:, 0] == pytest.approx(0.1 * np.arange(6))
    assert joints.steps.tolist() == list(range(6))
    assert joints.t == pytest.approx(0.01 * np.arange(6))
    assert (joints.names, joints.units, len(joints)) == (["a", "b"], {"x": "m"}, 6)
    assert joints.description.limits == {"lower": [-math.inf, 0.0]}


def test_numbers_and_texts_are_arrays_of_one_value_a_message(recording):
    assert recording["plant.camera"].width.tolist() == [200] * 6
    assert recording["plant.events"].text.tolist() == ["hi"]


def test_messages_are_decoded_one_by_one(recording):
    assert [step for step, _ in recording.messages("plant/camera")] == list(range(6))
    assert next(recording["plant.camera"].messages())[1] == IMAGE


def test_a_folder_of_a_run_stands_for_its_recording(path):
    assert "plant.joints" in Recording(path.parent)


def test_an_unknown_port_or_field_is_named_with_the_nearest_one(recording):
    with pytest.raises(KeyError) as caught:
        recording["plant.joint"]
    assert str(caught.value).endswith("did you mean 'plant/joints'?")
    assert isinstance(caught.value, WiringError)
    with pytest.raises(WiringError, match="plant/camera, plant/events"):
        recording.messages("x/y/z")
    with pytest.raises(WiringError, match="did you mean 'position'"):
        recording["plant.joints"]["positions"]
    assert not hasattr(recording["plant.joints"], "positions")


def test_vectors_that_are_absent_have_no_array(recording):
    with pytest.raises(WiringError, match="velocity is absent"):
        recording["plant.joints"]["velocity"]


def test_vectors_that_change_their_length_have_no_array(tmp_path):
    states = [JointState(position=[1.0]), JointState(position=[1.0, 2.0])]
    path = write(tmp_path / "other.mcap", joints=("JointState/1", [], states))
    with pytest.raises(WiringError, match="position is absent"):
        Recording(path)["plant.joints"]["position"]


@pytest.mark.parametrize("source", ["plant.joints", "{from: plant.joints, delay: 1}"])
def test_names_of_a_port_like_an_input_are_those_of_its_source(tmp_path, source):
    file = McapFile(tmp_path / "run.mcap")
    text = f"participants: {{arm: {{inputs: {{state: {source}}}}}}}"
    file.attach("scenario.yaml", text.encode())
    for topic, described in (("plant/joints", '{"names": ["a"]}'), ("arm/u", '{"like": "state"}')):
        file.add_channel(topic, "JointCommand/1", channel_metadata(*topic.split("/"), described))
    file.close()
    assert Recording(tmp_path)["arm.u"].names == ["a"]


def test_opening_reads_neither_messages_nor_chunks(path, monkeypatch):
    read = []
    pread = os.pread
    monkeypatch.setattr(os, "pread", lambda *args: read.append(args[1]) or pread(*args))
    recording = Recording(path)
    assert recording.ports.keys() == {"plant/joints", "plant/camera", "plant/events"}
    assert sum(read) < 20_000 < path.stat().st_size / 20


def test_a_port_is_read_without_the_chunks_it_is_not_in(path, monkeypatch):
    recording, read = Recording(path), []
    pread = os.pread
    monkeypatch.setattr(os, "pread", lambda *args: read.append(args[1]) or pread(*args))
    assert recording["plant.events"].last_step == 2
    assert sum(read) < path.stat().st_size / 3


def test_what_was_read_stays_when_the_file_is_closed(path):
    recording = Recording(path)
    before = recording["plant.joints"].position
    recording.close()
    assert recording["plant.joints"].position is before
    with pytest.raises(RecordingFailed, match=r"run\.mcap is closed"):
        list(recording["plant.camera"].messages())


@pytest.mark.parametrize(
    "options",
    [{"compression": CompressionType.NONE}, {"use_chunking": False}, {"use_statistics": False}],
)
def test_files_of_other_writers_read_the_same(path, tmp_path, options):
    other = Recording(rewrite(path, tmp_path / "other.mcap", 4096, **options))
    assert (
        other["plant.joints"].position.tolist() == Recording(path)["plant.joints"].position.tolist()
    )
    assert other.damage == recover(other.path, tmp_path / "fixed.mcap").damage == ""


def test_a_recording_cut_off_has_all_that_stands_before_the_cut(path, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    recording = Recording(cut)
    assert "bytes short" in recording.damage
    steps = recording["plant.joints"].steps.tolist()
    assert steps == list(range(len(steps)))
    assert 0 < len(steps) < 6


def test_a_chunk_that_is_corrupt_ends_the_recording_when_it_is_read(path, tmp_path):
    data = bytearray(path.read_bytes())
    start, length = chunks(data)[2]
    data[start + length // 2] ^= 1
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(data)
    recording = Recording(broken)
    assert recording.damage == ""
    assert len(recording["plant.camera"]) == 2
    assert recording.damage.startswith("a chunk is corrupt")
    assert recording["plant.joints"].last_step <= 2


def test_a_recording_of_no_messages_has_empty_arrays(tmp_path):
    recording = Recording(write(tmp_path / "none.mcap", joints=("JointState/1", ["a"], [])))
    joints = recording["plant.joints"]
    assert (len(joints), joints.last_step, recording.last_step) == (0, -1, -1)
    assert joints.t.shape == joints.position.shape == (0,)


def test_a_report_of_a_recording_with_images_takes_little_memory(tmp_path):
    image = Image(encoding="rgb8", data=bytes(1_000_000), **PIXELS)
    states = [JointState(position=[0.1 * n]) for n in range(150)]
    path = write(
        tmp_path / "run.mcap",
        joints=("JointState/1", ["a"], states),
        camera=("Image/1", [], [image] * 150),
    )
    tracemalloc.start()
    tracking = read_tracking(Recording(path))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(tracking.state_of("a").t) == 150
    assert peak < 60_000_000


def test_a_named_pipe_is_no_recording_and_nobody_waits_for_its_writer(tmp_path):
    os.mkfifo(tmp_path / "run.mcap")
    for read in (Recording, lambda path: recover(path, tmp_path / "out.mcap")):
        with pytest.raises(RecordingFailed, match="it is not a regular file"):
            read(tmp_path / "run.mcap")
    with pytest.raises(RecordingFailed, match="cannot be written"):
        McapFile(tmp_path / "run.mcap")
