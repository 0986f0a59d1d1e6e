"""A branch: the steps of a recording, and from one on a run with a change."""

import random
import textwrap

import pytest
from mcap.reader import make_reader
from support.messages.recordings import rewrite
from support.runs.joints import fault, run_joints, write_scenario

from stepbus_orchestrator.errors import ExitCode, RecordingFailed
from stepbus_orchestrator.recording.reader import Recording
from stepbus_orchestrator.replay import replay
from stepbus_orchestrator.replay.branch import branch
from stepbus_orchestrator.replay.rerun import Preparation
from stepbus_orchestrator.run.extensions.calls import Calls
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import CallRecord, WiringError

STEPS = 100
"""Of the recorded run; the mission publishes at every fourth."""

GAIN = """
    from stepbus import Config, Description, JointCommand, JointState, Participant

    class Controller(Participant):
        def __init__(self, config: Config) -> None:
            self.gain = config.param("gain", 1.0)

        def describe(self):
            return {"command": Description(like="joint_state")}

        def update(self, step):
            state = step.read("joint_state", JointState)
            return {"command": JointCommand(mode="torque",
                                            values=[-self.gain * q for q in state.position])}
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The recording of a run with two calls that change it."""
    folder = tmp_path_factory.mktemp("recorded")
    scenario = load(write_scenario(folder / "source"))
    calls = [
        CallRecord(step=step, participant="plant", method="put", args=[0, value])
        for step, value in ((20, 0.5), (60, -0.5))
    ]
    return run(
        scenario, Options(out=folder / "out", extensions=[Calls(calls)], host=InProcess())
    ).recording


def below(recording, step):
    """Return all messages of the steps below one: (topic, step, bytes)."""
    opened = Recording(recording)
    return [
        (topic, entry.step, entry.data)
        for topic, port in opened.ports.items()
        if topic != "stepbus/chain"
        for entry in port.entries()
        if entry.step < step
    ]


@pytest.mark.parametrize("at", sorted({0, 1, STEPS, *random.Random(15).sample(range(STEPS), 5)}))
def test_without_a_change_the_recording_is_the_same(recorded, tmp_path, at):
    found = branch(recorded, tmp_path / "b", at=at, in_process=True)
    assert found.result.exit_code == 0
    assert found.result.recording.read_bytes() == recorded.read_bytes()


@pytest.mark.parametrize("transport", ["unix", "tcp"])
def test_processes_of_their_own_make_the_same(recorded, tmp_path, transport):
    found = branch(recorded, tmp_path / "b", at=43, set=[f"bus.transport={transport}"])
    assert found.equal
    assert found.way_s > 0


@pytest.fixture
def gained(tmp_path):
    """A run of a controller with a gain."""
    path = write_scenario(tmp_path / "gain")
    (tmp_path / "gain" / "gain.py").write_text(textwrap.dedent(GAIN))
    program = [
        "controller.participant=gain.py:Controller",
        "controller.inputs={joint_state: plant.joint_state}",
    ]
    return run(load(path, program), Options(out=tmp_path / "a", host=InProcess())).recording


@pytest.fixture
def changed(gained, tmp_path):
    """The recording of a branch of it, with another gain from step 43 on."""
    gain = ["controller.params={gain: 5}"]
    return branch(gained, tmp_path / "b", at=43, set=gain, in_process=True).result.recording


def test_a_changed_parameter_leaves_the_recording_at_the_step(gained, changed):
    now, before = Recording(changed), Recording(gained)
    assert below(changed, 43) == below(gained, 43)
    values = [part["controller.command"].values[43] for part in (now, before)]
    assert values[0] == pytest.approx(5 * values[1])
    assert any(values[0])


def test_a_program_is_changed_by_its_absolute_path_and_runs_again_from_the_recording(
    gained, tmp_path
):
    other = tmp_path / "other" / "gain.py"
    other.parent.mkdir()
    other.write_text(textwrap.dedent(GAIN).replace("-self.gain", "-3 * self.gain"))
    setting = f"controller.participant={other}:Controller"
    found = branch(gained, tmp_path / "b", at=43, set=[setting], in_process=True)
    assert found.changed == ["controller"]
    now, before = Recording(found.result.recording), Recording(gained)
    values = [part["controller.command"].values[43] for part in (now, before)]
    assert values[0] == pytest.approx(3 * values[1])
    assert Preparation(found.result.recording, tmp_path / "c").run().equal


def test_a_branch_is_branched_again_but_not_before_its_own_step(changed, tmp_path):
    assert branch(changed, tmp_path / "c", at=70, in_process=True).equal
    with pytest.raises(RecordingFailed, match="is a branch from step 43"):
        branch(changed, tmp_path / "d", at=42, in_process=True)


def test_a_replay_compares_a_changed_participant_from_there_on(changed):
    replayed = replay(changed, "controller", recorded=True)
    assert replayed.equal
    assert sum(port.equal for port in replayed.ports) == STEPS - 43


def test_a_call_is_made_before_the_step(recorded, tmp_path):
    found = branch(recorded, tmp_path / "b", at=43, calls=["plant put 1 2.5"], in_process=True)
    assert below(found.result.recording, 43) == below(recorded, 43)
    assert Recording(found.result.recording)["plant.joint_state"].position[43][1] == 2.5
    assert Preparation(found.result.recording, tmp_path / "c").run().equal


@pytest.mark.parametrize(
    ("call", "why"),
    [
        ("plant put 1 9.9", "9.9 is beyond the stop"),
        ("plant set 1 2", "plant has no call 'set'"),
        ("mission put 1 2", "mission does not accept calls"),
    ],
)
def test_a_call_that_fails_ends_the_branch(recorded, tmp_path, call, why):
    found = branch(recorded, tmp_path / "b", at=43, calls=[call], in_process=True)
    assert found.result.exit_code == ExitCode.SCENARIO
    assert why in found.result.reason


def test_a_participant_that_is_not_deterministic_is_named(tmp_path):
    path = write_scenario(tmp_path / "s")
    program = path.parent / "gain.py"
    random_text = (
        textwrap.dedent(GAIN)
        .replace("from stepbus", "import os\nfrom stepbus", 1)
        .replace("-self.gain * q", "(step.index > 30) * os.urandom(1)[0] - q")
    )
    program.write_text(random_text)
    overrides = [
        "controller.participant=gain.py:Controller",
        "controller.inputs={joint_state: plant.joint_state}",
    ]
    first = run(load(path, overrides), Options(out=tmp_path / "a", host=InProcess()))
    found = branch(first.recording, tmp_path / "b", at=90, in_process=True)
    assert found.result.exit_code == ExitCode.DIFFERENT
    assert found.result.participant == "controller"
    assert 30 < found.result.at_step < 90
    assert "controller/command: values[" in found.result.reason


def test_an_end_that_a_changed_participant_asks_for_on_the_way_is_not_its_to_ask(
    recorded, tmp_path
):
    early = fault("controller", "end", 10)
    found = branch(recorded, tmp_path / "b", at=43, set=[early], in_process=True)
    assert (found.result.exit_code, found.result.steps) == (0, STEPS)


def test_it_ends_where_a_changed_participant_asks_for_it(recorded, tmp_path):
    end = fault("controller", "end", 70)
    assert branch(recorded, tmp_path / "b", at=43, set=[end], in_process=True).result.steps == 71


def test_a_fault_hits_behind_the_step(recorded, tmp_path):
    found = branch(recorded, tmp_path / "b", at=43, faults=["kill plant at 50"])
    assert found.result.exit_code == ExitCode.DIED
    assert (found.result.participant, found.result.at_step) == ("plant", 50)


def test_a_fault_on_messages_reaches_who_reads_them(recorded, tmp_path):
    changes = {"set": ["controller.step_timeout=500ms"], "faults": ["corrupt plant at 50"]}
    found = branch(recorded, tmp_path / "b", at=43, **changes, in_process=True)
    assert found.result.exit_code == 0
    assert found.result.drops["controller"] >= 1


def test_a_longer_run_continues_where_the_recording_ends(recorded, tmp_path):
    found = branch(recorded, tmp_path / "b", at=STEPS, set=["duration=1s"], in_process=True)
    assert found.result.steps == 200
    assert below(found.result.recording, STEPS) == below(recorded, STEPS)


def test_a_time_stands_for_its_step(recorded, tmp_path):
    assert branch(recorded, tmp_path / "b", at="215ms", in_process=True).at == 43


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"faults": ["kill plant at 10"]}, "'kill plant at 10' is before step 43"),
        ({"set": ["duration=100ms"]}, "would end at step 20, before step 43"),
        ({"at": 101}, r"step 101 is past the end of .* \(100 complete"),
        ({"at": "216ms"}, r"at: 216ms is 43\.2 steps of 5ms, .* 215ms or 220ms"),
        ({"set": ["step=1ms"]}, "step, seed, ports or rates"),
        ({"set": ["seed=3"]}, "step, seed, ports or rates"),
        ({"set": ["mission.every=2"]}, "step, seed, ports or rates"),
    ],
)
def test_what_no_branch_can_be_is_refused(recorded, tmp_path, given, why):
    with pytest.raises((RecordingFailed, WiringError), match=why):
        branch(recorded, tmp_path / "b", **{"at": 43, **given})


def test_a_run_that_failed_is_branched_before_it_went_wrong(tmp_path):
    failed = run_joints(tmp_path, fault("plant", "raise", 70), in_process=True)
    repaired = "plant.params={}"
    found = branch(failed.recording, tmp_path / "b", at=60, set=[repaired], in_process=True)
    assert (found.result.exit_code, found.result.steps) == (0, STEPS)
    assert below(found.result.recording, 60) == below(failed.recording, 60)


def test_a_failed_participant_is_replaced_behind_the_step(recorded, tmp_path):
    held = ["controller.on_fault=hold"]
    found = branch(recorded, tmp_path / "b", at=43, set=held, faults=["kill controller at 60"])
    assert found.result.exit_code == ExitCode.DIED
    assert "its commands were held from step 60" in found.result.reason
    assert found.result.steps > 60


def test_nobody_is_replaced_on_the_way(recorded, tmp_path):
    changes = ["controller.on_fault=hold", fault("controller", "kill", 10)]
    result = branch(recorded, tmp_path / "b", at=43, set=changes).result
    assert (result.exit_code, result.participant) == (ExitCode.DIED, "controller")
    assert "held" not in result.reason


@pytest.mark.slow
def test_a_run_that_was_held_is_branched_up_to_the_fault(tmp_path):
    held = run_joints(tmp_path, "controller.on_fault=hold", fault("controller", "raise", 60))
    assert branch(held.recording, tmp_path / "b", at=50).result.exit_code == ExitCode.FAULT
    with pytest.raises(RecordingFailed, match="replaced from step 60"):
        branch(held.recording, tmp_path / "c", at=62)


def test_a_failed_run_says_what_lacks(tmp_path):
    failed = run_joints(tmp_path, fault("controller", "raise", 60))
    assert failed.exit_code == ExitCode.FAULT
    with failed.recording.open("rb") as file:
        reader = make_reader(file)
        records = {item.name: item.metadata for item in reader.iter_metadata()}
        ends = {channel.topic: one.sequence for _, channel, one in reader.iter_messages()}
    assert records["incomplete"] == {
        "plant": str(ends["plant/joint_state"] + 1),
        "controller": "60",
        "mission": str(ends["mission/reference"] + 4),
    }


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("on_fault", {"participant": "controller", "first": "x"}),
        ("branch", {"plant": "-1"}),
        ("incomplete", {"controller": "²"}),
        ("branch", {"plant": "9" * 5000}),
    ],
)
def test_metadata_that_stepbus_did_not_write_has_no_step(recorded, tmp_path, name, content):
    path = rewrite(recorded, tmp_path / "other.mcap", 4096, noted={name: content})
    assert Recording(path).steps_in(name) == {}


def test_a_changed_participant_counts_from_the_step_on(recorded, tmp_path):
    other = "controller.params={fault: gain, at: 0}"
    found = branch(recorded, tmp_path / "b", at=43, set=[other], in_process=True)
    assert found.result.exit_code == 0
    assert found.changed == ["controller"]
    assert below(found.result.recording, 43) == below(recorded, 43)


def test_a_participant_that_fails_on_the_way_is_named(recorded, tmp_path):
    crash = fault("controller", "raise", 10)
    found = branch(recorded, tmp_path / "b", at=43, set=[crash], in_process=True)
    assert found.result.exit_code == ExitCode.FAULT
    assert found.result.participant == "controller"
