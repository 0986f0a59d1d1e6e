"""The recorder writes a run once, and nothing after it."""

import msgspec
import pytest
from mcap.reader import make_reader
from support.messages.recordings import messages

from stepbus_orchestrator.errors import ParticipantFault, RecordingFailed
from stepbus_orchestrator.recording import McapFile, Recorder, Recording
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_orchestrator.scenario.ports import OutputSpec
from stepbus_schemas import Event, JointCommand, Outputs, encode

STEP_NS = 1_000_000


def outputs(step, bulk=None, **ports):
    raw = {port: msgspec.Raw(data) for port, data in ports.items()}
    return Outputs(token="", step=step, t_ns=step * STEP_NS, ports=raw, bulk=bulk or {})


def command(value=1.0):
    return encode(JointCommand(mode="torque", values=[value]))


WARNING = encode(Event(level="warning", text="hot"))


@pytest.fixture
def specs():
    outputs = {"plant": {"events": "Event/1"}, "controller": {"command": "JointCommand/1"}}
    return [
        ParticipantSpec(
            name=name, exec=("x",), outputs={port: OutputSpec(type=t) for port, t in ports.items()}
        )
        for name, ports in outputs.items()
    ]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.mcap"


@pytest.fixture
def warned():
    return []


@pytest.fixture
def recorder(path, specs, warned):
    recorder = Recorder(McapFile(path), specs, STEP_NS, lambda *event: warned.append(event[:3]))
    recorder.open_channels({}, {})
    return recorder


def schedule(path):
    return " ".join(f"{topic}@{step}" for topic, _, step, _ in messages(path))


def test_outputs_behind_the_closing_step_are_neither_recorded_nor_reported(recorder, path, warned):
    for step in range(5):
        recorder.offer("plant", outputs(step, events=WARNING))
    recorder.finish(2, ["plant"])
    recorder.abort()
    assert schedule(path) == "plant/events@0 plant/events@1 plant/events@2 stepbus/chain@2"
    assert warned == [("plant", "events", step) for step in range(3)]


@pytest.mark.parametrize("ends", ["finish", "abort"])
def test_a_fact_stands_before_the_messages_of_its_step_whatever_has_arrived(tmp_path, specs, ends):
    files = []
    for arrived in (0, 2, 3):
        files.append(tmp_path / f"{arrived}.mcap")
        recorder = Recorder(McapFile(files[-1]), specs, STEP_NS, None)
        recorder.open_channels({}, {})
        for step in range(5):
            if step == arrived:
                recorder.add_metadata("on_fault", {"first": "3"}, before=3)
            recorder.offer("plant", outputs(step, events=WARNING))
            recorder.write_below(step)
        if ends == "finish":
            recorder.finish(4, ["plant"])
        else:
            recorder.abort()
    assert len({file.read_bytes() for file in files}) == 1
    assert b"on_fault" in files[0].read_bytes()


def test_those_who_do_not_close_publish_nothing_at_the_closing_step(recorder, path):
    recorder.offer("plant", outputs(0, events=WARNING))
    recorder.offer("controller", outputs(0, command=command()))
    recorder.finish(0, ["controller"])
    assert schedule(path) == "controller/command@0 stepbus/chain@0"


def test_nothing_can_be_added_to_a_closed_recording(recorder, tmp_path):
    recorder.finish(0, [])
    with (tmp_path / "other").open("wb"):  # may get the descriptor that the recording had
        recorder.offer("controller", outputs(0, command=command()))
        with pytest.raises(RecordingFailed, match="nothing can be added"):
            recorder.write_below(1)
    assert (tmp_path / "other").read_bytes() == b""


def test_an_aborted_run_keeps_what_is_before_a_broken_message(recorder, path):
    for step in range(3):
        recorder.offer("plant", outputs(step, events=b"\xc1" if step == 1 else WARNING))
        recorder.offer("controller", outputs(step, command=command()))
    recorder.abort()
    written = schedule(path)
    # A message behind it would stand behind a hole.
    assert "plant/events@0 controller/command@0 controller/command@1" in written
    assert written.count("plant/events") == 1
    assert "controller/command@2" in written


def test_an_aborted_run_has_every_chain_that_is_due(path):
    spec = ParticipantSpec(
        name="mission", exec=("x",), every=4, outputs={"events": OutputSpec(type="Event/1")}
    )
    file = McapFile(path)
    file.attach("scenario.yaml", b"participants: {mission: {every: 4}}")
    recorder = Recorder(file, [spec], STEP_NS, None)
    recorder.open_channels({}, {})
    # It is ahead of one that has failed: no step is complete.
    for step in range(0, 73, 4):
        recorder.offer("mission", outputs(step, events=WARNING))
    recorder.abort()
    assert "stepbus/chain@63 mission/events@64" in schedule(path)
    assert schedule(path).endswith("stepbus/chain@72")
    assert Recording(path).holes() == []


def test_nothing_is_recorded_behind_bulk_content_that_never_came(path):
    ports = {"events": OutputSpec(type="Event/1", bulk=True)}
    spec = ParticipantSpec(name="plant", exec=("x",), outputs=ports)
    recorder = Recorder(McapFile(path), [spec], STEP_NS, None)
    recorder.open_channels({}, {})
    for step in range(4):
        recorder.offer("plant", outputs(step, bulk={"events": len(WARNING)}))
        if step != 2:
            recorder.offer_bulk("plant", "events", step, WARNING)
    recorder.abort()
    assert schedule(path) == "plant/events@0 plant/events@1 stepbus/chain@1"


def test_bulk_content_of_another_length_leaves_no_hole(path):
    ports = {
        "state": OutputSpec(type="Event/1"), "image": OutputSpec(type="Image/1", bulk=True)
    }  # fmt: skip
    spec = ParticipantSpec(name="plant", exec=("x",), outputs=ports)
    file = McapFile(path)
    file.attach("scenario.yaml", b"participants: {plant: {}}")
    recorder = Recorder(file, [spec], STEP_NS, None)
    recorder.open_channels({}, {})
    for step in range(30):
        recorder.offer(
            "plant", outputs(step, bulk={"image": 5} if step == 3 else {}, state=WARNING)
        )
    recorder.offer_bulk("plant", "image", 3, b"four")
    with pytest.raises(ParticipantFault, match="announced 5 bytes on bulk port 'image'"):
        recorder.write_below(30)
    recorder.abort()
    assert schedule(path).endswith("plant/state@2 plant/state@3")
    assert Recording(path).holes() == []


def test_a_broken_closing_message_fails_and_leaves_a_complete_recording(recorder, path):
    recorder.offer("plant", outputs(0, events=b"\xc1"))
    recorder.offer("controller", outputs(0, command=command()))
    with pytest.raises(ParticipantFault, match=r"step 0 \(t = 0.000 s\): plant.events is"):
        recorder.finish(0, ["plant", "controller"])
    assert schedule(path) == "controller/command@0 stepbus/chain@0"


def test_a_step_at_which_nobody_publishes_is_no_part_of_the_file(path):
    file = McapFile(path)
    channel = file.add_channel("plant/events", "Event/1", {})
    file.add(channel, 1, WARNING, 0)
    file.add_all([], 10**9, 5)
    file.close()
    with path.open("rb") as opened:
        summary = make_reader(opened).get_summary()
    assert summary.statistics.message_end_time == summary.chunk_indexes[0].message_end_time == 1
