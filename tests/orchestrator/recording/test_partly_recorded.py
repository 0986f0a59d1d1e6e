"""Outputs that are recorded now and then, or not at all (`record` in a scenario)."""

import pytest
from support.messages.recordings import messages

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import RecordingFailed, ScenarioError
from stepbus_orchestrator.recording import Recording, recover
from stepbus_orchestrator.recording.chains import Holes
from stepbus_orchestrator.replay.branch import branch
from stepbus_orchestrator.replay.execute import replay
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options
from stepbus_orchestrator.run.run_scenario import run as run_scenario
from stepbus_orchestrator.scenario.load import load

PROGRAMS = """
import random

from stepbus import Participant
from stepbus.messages import Event, Image, JointReference

class Camera(Participant):
    def output(self, step):
        data = random.Random(step.index).randbytes(160 * 160 * 3)
        image = Image(width=160, height=160, encoding="rgb8", data=data, focal=(1.0, 1.0),
                      centre=(0.0, 0.0))
        return {"image": image, "events": Event(level="info", text="click")}

class Eye(Participant):
    def update(self, step):
        row = [float(step.read("image", Image).data[0])]
        return {"seen": JointReference(position=row, velocity=row, acceleration=row)}
"""
SCENARIO = """
name: eye
step: 5ms
duration: 150ms
participants:
  camera:
    participant: eye.py:Camera
    publishes: first
    every: 2
    outputs: {image: {type: Image/1, bulk: true}, events: Event/1}
  eye:
    participant: eye.py:Eye
    inputs: {image: camera.image}
    outputs: {seen: JointReference/1}
"""
IMAGE = "camera.outputs.image.record"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return what runs the scenario, and returns the recording, once for each way to record."""
    folder, made = tmp_path_factory.mktemp("eye"), {}
    (folder / "eye.py").write_text(PROGRAMS)
    (folder / "scenario.yaml").write_text(SCENARIO)

    def record(*settings):
        if settings not in made:
            options = Options(out=folder / f"run{len(made)}", host=InProcess())
            result = run_scenario(load(folder, settings), options)
            assert result.exit_code == 0, result.reason
            assert not result.warnings
            made[settings] = result.recording
        return made[settings]

    record.folder = folder
    return record


@pytest.mark.parametrize(
    ("how", "steps"), [("every 5", [0, 10, 20, 30]), ("off", []), ("all", list(range(0, 32, 2)))]
)
def test_a_port_is_recorded_as_asked_and_the_others_whole(recorded, tmp_path, how, steps):
    recording = Recording(recorded(f"{IMAGE}={how}"))
    assert recording.flaws() == []
    image = recording.ports["camera/image"]
    assert (image.steps.tolist(), image.record) == (steps, how)
    assert (recording.ports["eye/seen"].record, len(recording["camera/events"])) == ("all", 16)
    whole, image_of = messages(recorded()), "camera/image"
    rest = [
        row for row in messages(recording.path) if not row[0].startswith(("stepbus/", image_of))
    ]
    assert rest == [row for row in whole if not row[0].startswith(("stepbus/", image_of))]
    kept = [row for row in messages(recording.path) if row[0] == image_of]
    assert kept == [row for row in whole if row[0] == image_of and row[2] in steps]
    recovery = recover(recording.path, tmp_path / "again.mcap")
    assert recovery.target.read_bytes() == recording.path.read_bytes()
    assert recording.path.read_bytes() == recorded(f"{IMAGE}={how}", "window=1").read_bytes()


def test_only_what_should_have_been_recorded_is_a_hole(recorded):
    recording = Recording(recorded(f"{IMAGE}=every 5"))
    holes = Holes(recording.scenario)
    for topic, _, step, data in messages(recording.path):
        if (topic, step) != ("camera/image", 20):
            holes.add(topic, step, data)
    (broken,) = holes.found
    assert "breaks at or before step 30" in broken


def test_what_reads_such_a_port_cannot_be_repeated(recorded, tmp_path):
    path = recorded(f"{IMAGE}=every 5")
    sentence = r"eye reads camera\.image, which is not fully recorded \(`record: every 5`\)"
    with pytest.raises(RecordingFailed, match=sentence):
        replay(path, "eye")
    with pytest.raises(RecordingFailed, match=sentence):
        branch(path, tmp_path / "branch", at=10)
    assert not (tmp_path / "branch" / "logs").exists()


def test_what_publishes_it_is_replayed_and_compared_where_it_is_recorded(recorded):
    found = replay(recorded(f"{IMAGE}=every 5"), "camera", recorded=True)
    assert found.equal
    assert {port.topic: port.equal for port in found.ports}["camera/image"] == 4
    assert "compared where it is recorded" in " ".join(found.notes)


@pytest.mark.parametrize(("how", "common"), [("every 5", 4), ("off", 0)])
def test_it_is_compared_where_both_have_it(recorded, how, common):
    found = diff(recorded(), recorded(f"{IMAGE}={how}"))
    assert found.equal
    assert {port.topic: port.equal for port in found.ports}["camera/image"] == common
    note = f"only at the steps that both recordings contain (all in the first, {how} in"
    assert any(note in line for line in found.notes)


def test_info_says_what_is_not_recorded_whole(recorded, capsys):
    line = "recorded  all but camera/image off\n"
    main(["info", str(recorded(f"{IMAGE}=off"))])
    assert line in capsys.readouterr().out
    main(["info", str(recorded())])
    assert line[:10] not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        (
            f"{IMAGE}=of",
            r"must be all, off or every N, e.g. every 10, not 'of'.*did you mean 'off'",
        ),
        (f"{IMAGE}=every 0", "must be all, off or every N"),
        (f"{IMAGE}=evry 10", r"did you mean 'every 10'"),
        (f"{IMAGE}=10", "record"),
        (
            "camera.outputs.events={type: Event/1, record: off}",
            "an output of Event/1 must be recorded completely",
        ),
    ],
)
def test_what_cannot_be_meant_is_refused(recorded, setting, sentence):
    with pytest.raises(ScenarioError, match=sentence):
        load(recorded.folder, [setting])
