"""Bulk content that goes through slots is recorded as the same run records that of messages."""

from pathlib import Path

import pytest
from support.runs.joints import write_scenario

from stepbus_orchestrator.replay.execute import replay
from stepbus_orchestrator.run.hosts import InProcess, Processes
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

PROGRAM = '''
import os
import resource
from pathlib import Path

import stepbus
from stepbus.messages import BytesMessage, Scalars
from stepbus_participant.bus import slots

KIND = ""


class Camera(stepbus.Participant):
    """Publishes more and more, and nothing at every third step."""

    def output(self, step):
        if step.index % 3 == 2:
            return {}
        return {"frame": BytesMessage(data=bytes([step.index]) * (1000 + step.index**3))}


class Viewer(stepbus.Participant):
    def update(self, step):
        names = (f"/proc/self/fd/{number}" for number in os.listdir("/proc/self/fd"))
        links = [os.readlink(name) for name in names if os.path.exists(name)]
        frames = [link for link in links if link.endswith("/camera.frame")]
        used = [name for name in frames if os.stat(name).st_size]
        Path(f"{self.config.name}.used").write_text("".join(used))
        frame = step.get("frame")
        if KIND == "keeps" and frame:
            self.kept = [*getattr(self, "kept", ()), (frame, bytes(bytearray(frame.data)))]
            assert all(kept.data == copy for kept, copy in self.kept)
        if "seen" in self.config.outputs:
            return {"seen": Scalars(values=[float(sum(frame.data)) if frame else -1.0])}


write = slots.SlotWriter.write


def write_wrongly(self, step, content):
    offset = write(self, step, content)
    if step == 12:
        if KIND == "cut":
            os.ftruncate(self._fd, offset + 100)
        elif KIND == "earlier":
            os.pwrite(self._fd, bytes([11]), offset)
        elif KIND == "elsewhere":
            return offset + 4096
    return offset


if KIND == "cannot":
    slots.Slots._open = lambda self, names, mode: None
elif KIND == "full":
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000))
elif KIND == "cut while it is read":
    slot = slots._ReadFile.slot

    def cut(self, offset, size):
        view = slot(self, offset, size)
        os.truncate(os.readlink(f"/proc/self/fd/{self.fd}"), 0)
        return view

    slots._ReadFile.slot = cut
elif KIND:
    slots.SlotWriter.write = write_wrongly
'''

SCENARIO = """
name: frames
step: 5ms
duration: 200ms
window: 8
participants:
  camera:
    participant: camera.py:Camera
    publishes: first
    outputs: {frame: {type: Bytes/1, bulk: true}}
  viewer:
    participant: viewer.py:Viewer
    inputs: {frame: camera.frame}
    outputs: {seen: Scalars/1}
  slow:
    participant: slow.py:Viewer
    every: 3
    publishes: last
    inputs: {frame: {from: camera.frame, delay: 2}}
"""


FED_BACK = SCENARIO.replace(
    "    publishes: first\n", "    publishes: first\n    inputs: {a: viewer.seen}\n"
)
FED_BACK = FED_BACK.replace("bulk: true", "bulk: true, record: off").partition("  slow:")[0]


class Heard(Observer):
    """Keeps what an observer is told, as text."""

    def __init__(self):
        self.text = ""

    def event(self, level, source, step, text):
        self.text += f"{source}@{step}: {text}\n"


def record(folder, *overrides, host=None, faults=(), observer=None, text=SCENARIO, **kinds):
    """Run the scenario; return its result, and the file of slots that each viewer has seen used."""
    path = write_scenario(folder / "source", text)
    for name in ("camera", "viewer", "slow"):
        kind = f'KIND = "{kinds.get(name, "")}"'
        (folder / "source" / f"{name}.py").write_text(PROGRAM.replace('KIND = ""', kind))
    scenario = load(path, overrides, faults=faults)
    result = run(scenario, Options(out=folder / "out", host=host or Processes()), observer)
    used = {
        p.stem: Path(p.read_text()) for p in (folder / "source").glob("*.used") if p.read_text()
    }
    return result, used


@pytest.fixture(scope="module")
def in_messages(tmp_path_factory):
    result, used = record(tmp_path_factory.mktemp("messages"), "bus.transport=tcp")
    assert (result.exit_code, used) == (0, {}), result.reason
    return result.messages_sha256


def test_the_recording_is_that_of_content_in_messages_and_no_file_is_left(tmp_path, in_messages):
    result, used = record(tmp_path)
    assert (result.exit_code, result.messages_sha256) == (0, in_messages), result.reason
    assert (used.keys(), used["slow"].parent.exists()) == ({"viewer", "slow"}, False)


@pytest.mark.parametrize("window", [1, 3, 64])
def test_with_any_window_it_is_the_same(tmp_path, in_messages, window):
    result, used = record(tmp_path, f"window={window}")
    assert (result.exit_code, result.messages_sha256) == (0, in_messages), result.reason
    assert used


def test_in_one_process_and_with_a_program_that_cannot_there_are_none(tmp_path, in_messages):
    runs = {
        "in one process": record(tmp_path / "1", host=InProcess()),
        "a reader cannot": record(tmp_path / "3", slow="cannot"),
        "the source cannot": record(tmp_path / "4", camera="cannot"),
    }
    found = {name: (result.messages_sha256, used) for name, (result, used) in runs.items()}
    assert found == dict.fromkeys(runs, (in_messages, {}))


def test_on_the_quick_transport_content_has_to_be_in_slots(tmp_path, in_messages):
    result, used = record(tmp_path / "1", "bus.low_latency=true")
    assert (result.exit_code, result.messages_sha256) == (0, in_messages), result.reason
    assert used
    assert replay(result.recording, "viewer").equal
    result, _ = record(tmp_path / "2", "bus.low_latency=true", slow="cannot")
    assert result.exit_code == 3
    assert "camera.frame travels in messages" in result.reason


@pytest.mark.slow
def test_a_reader_that_is_stopped_for_a_second_finds_all(tmp_path, in_messages):
    result, used = record(tmp_path, faults=["freeze slow at 12 for 1s"])
    assert (result.exit_code, result.messages_sha256) == (0, in_messages), result.reason
    assert used


def test_what_is_published_again_finds_its_content(tmp_path, in_messages):
    heard = Heard()
    result, used = record(tmp_path, "window=1", faults=["drop camera at 12"], observer=heard)
    assert (result.exit_code, result.messages_sha256) == (0, in_messages), result.reason
    assert used
    assert "camera@12: " in heard.text
    assert "is published again" in heard.text


@pytest.mark.parametrize("name", ["camera", "viewer"])
def test_who_is_killed_ends_the_run_and_leaves_no_file(tmp_path, name):
    result, used = record(tmp_path, faults=[f"kill {name} at 12"])
    assert (result.exit_code, result.participant) == (5, name), result.reason
    assert not used["slow"].parent.exists()


@pytest.mark.parametrize("kind", ["cut", "earlier", "elsewhere"])
def test_a_slot_that_does_not_hold_what_was_announced_names_port_and_step(tmp_path, kind):
    result, _ = record(tmp_path, "window=1", camera=kind)
    assert (result.exit_code, result.participant) == (4, "camera"), result.reason
    assert "step 12" in result.reason
    assert "frame" in result.reason
    assert "its slot does not hold" in result.reason


def test_who_reads_what_is_cut_at_that_very_moment_is_killed_and_the_run_says_why(tmp_path):
    off = "participants.camera.outputs.frame.record=off"
    result, _ = record(tmp_path, "window=1", off, viewer="cut while it is read")
    assert (result.exit_code, result.participant) == (5, "viewer"), result.reason
    assert "killed by SIGBUS" in result.reason


def test_a_source_that_waits_for_its_reader_has_one_slot(tmp_path):
    kinds = {"text": FED_BACK, "viewer": "keeps"}
    plain, _ = record(tmp_path / "1", "bus.transport=tcp", **kinds)
    result, used = record(tmp_path / "2", **kinds)
    assert (result.exit_code, plain.exit_code) == (0, 0), result.reason or plain.reason
    assert result.messages_sha256 == plain.messages_sha256
    assert used.keys() == {"viewer"}
    result, _ = record(tmp_path / "3", camera="full", **kinds)
    assert "cannot reserve a slot of 0.0044 MB in " in result.reason


def test_where_there_is_no_room_for_slots_the_run_says_so_at_the_first(tmp_path):
    result, _ = record(tmp_path, camera="full")
    assert (result.exit_code, result.participant) == (7, "camera"), result.reason
    assert "cannot reserve 12 slots of 0.00102 MB" in result.reason
