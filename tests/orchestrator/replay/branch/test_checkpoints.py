"""Checkpoints: a branch starts from the newest states, and is the same as from step 0."""

import hashlib
import json
import random
import shutil

import msgspec
import pytest

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.replay.branch import branch
from stepbus_orchestrator.run.extensions.calls import Calls
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import CallRecord

STEPS = 300
EVERY = 100
NAMES = ("plant", "controller", "mission")
SAVED = ["duration=1500ms", "checkpoint=500ms"]
CALLS = [
    CallRecord(step=120, participant="controller", method="set", args=["kp", 150]),
    CallRecord(step=150, participant="mission", method="set_target", args=["joint1", 0.5, 0.4]),
    CallRecord(step=200, participant="mission", method="set", args=["omega", 3.0]),
]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The SHA-256 of the run without checkpoints."""
    out = tmp_path_factory.mktemp("plain") / "out"
    options = Options(out=out, extensions=[Calls(CALLS)], host=InProcess())
    return run(load("two_link/pid", SAVED[:1]), options).sha256


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """The recording of a run with checkpoints and calls that change it."""
    out = tmp_path_factory.mktemp("saved") / "out"
    return run(
        load("two_link/pid", SAVED), Options(out=out, extensions=[Calls(CALLS)], host=InProcess())
    ).recording


@pytest.fixture
def copy(saved, tmp_path):
    """A copy of the recording and its checkpoints, to damage."""
    shutil.copytree(saved.parent, tmp_path / "copy")
    return tmp_path / "copy" / "run.mcap"


def rewrite(recording, name, step, change):
    """Change a saved state, and its hash in the index."""
    folder = recording.parent / "checkpoints"
    state = change((folder / f"{name}.{step}").read_bytes())
    (folder / f"{name}.{step}").write_bytes(state)
    index = json.loads((folder / "index.json").read_bytes())
    index["states"][name][str(step)] = hashlib.sha256(state).hexdigest()
    (folder / "index.json").write_text(json.dumps(index))


def test_the_recording_is_that_of_a_run_without(saved, plain):
    assert hashlib.sha256(saved.read_bytes()).hexdigest() == plain


@pytest.mark.parametrize(
    "at", sorted({101, 120, 121, 151, 201, STEPS, *random.Random(15).sample(range(STEPS), 5)})
)
def test_a_branch_from_checkpoints_is_the_recording(saved, tmp_path, at):
    found = branch(saved, tmp_path / "b", at=at, in_process=True)
    start = (at - 1) // EVERY * EVERY
    assert found.equal, found.result.reason
    assert found.restored == ({} if not start else dict.fromkeys(NAMES, start))


@pytest.mark.slow
@pytest.mark.parametrize("transport", ["unix", pytest.param("tcp", marks=pytest.mark.slow)])
def test_processes_of_their_own_save_and_start_from_checkpoints_too(
    saved, plain, transport, tmp_path
):
    overrides = [*SAVED, f"bus.transport={transport}"]
    options = Options(out=tmp_path / "a", extensions=[Calls(CALLS)])
    result = run(load("two_link/pid", overrides), options)
    assert result.sha256 == plain
    found = branch(result.recording, tmp_path / "b", at=250, set=overrides[2:])
    assert found.equal, found.result.reason
    assert found.restored == dict.fromkeys(NAMES, 200)


def test_a_change_makes_the_same_with_and_without(saved, tmp_path):
    change = {"set": ["controller.params.kd=10"], "in_process": True}
    a = branch(saved, tmp_path / "a", at=250, **change)
    b = branch(saved, tmp_path / "b", at=250, checkpoints=False, **change)
    assert a.result.sha256 == b.result.sha256
    assert a.restored == {"plant": 200, "mission": 200}


def test_a_damaged_state_is_named_and_an_earlier_one_used(copy, tmp_path):
    path = copy.parent / "checkpoints" / "plant.200"
    path.write_bytes(path.read_bytes()[:-1] + b"\0")
    found = branch(copy, tmp_path / "b", at=250, in_process=True)
    assert found.equal
    assert found.restored == {"plant": 100, "controller": 200, "mission": 200}
    assert [note for note in found.notes if "plant.200 is damaged" in note]


@pytest.mark.parametrize("index", [b"", b"{}", b'{"recording": "00", "states": {}}'])
def test_states_of_no_or_another_recording_are_not_used(copy, tmp_path, index):
    (copy.parent / "checkpoints" / "index.json").write_bytes(index)
    found = branch(copy, tmp_path / "b", at=250, in_process=True)
    assert found.equal
    assert "no checkpoints: " in found.notes[0]


def test_a_state_that_leads_elsewhere_is_named(copy, tmp_path):
    def spoil(state):
        whole = msgspec.msgpack.decode(state)
        own = msgspec.msgpack.decode(whole["own"])
        own["integral"][0] += 1e-9
        whole["own"] = msgspec.msgpack.encode(own)
        return msgspec.msgpack.encode(whole)

    rewrite(copy, "controller", 200, spoil)
    found = branch(copy, tmp_path / "b", at=250, in_process=True)
    assert found.result.exit_code == ExitCode.DIFFERENT
    assert "does not repeat the recording" in found.result.reason
    assert "its checkpoint before step 200" in found.result.reason
    assert "--no-checkpoints" in found.result.reason


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda _state: b"\xc1", "cannot read the checkpoint"),
        (
            lambda state: state.replace(b"has_reported_delay", b"has_reported_decay"),
            "cannot be restored",
        ),
        (lambda state: state.replace(b"joint_state", b"joint_stake"), "with different inputs"),
    ],
)
def test_a_state_that_nobody_can_take_is_one_sentence(copy, tmp_path, change, why):
    rewrite(copy, "controller", 200, change)
    found = branch(copy, tmp_path / "b", at=250, in_process=True)
    assert found.result.exit_code == ExitCode.FAULT
    assert "controller before step 200" in found.result.reason
    assert why in found.result.reason


def test_a_branch_of_a_branch_has_checkpoints_of_its_own(saved, tmp_path):
    changed = ["controller.params.kd=10", "checkpoint=250ms"]
    first = branch(saved, tmp_path / "a", at=130, set=changed, in_process=True)
    again = branch(first.result.recording, tmp_path / "b", at=280, in_process=True)
    assert again.equal, again.result.reason
    assert set(again.restored.values()) == {250}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["two_link", *(f"two_link/{n}" for n in ("encoders", "tip", "pair", "velocity_force"))]
)
def test_shipped_scenarios_start_from_checkpoints(name, tmp_path):
    options = Options(out=tmp_path / "out", host=InProcess())
    overrides = ["duration=3s", "checkpoint=700ms"]
    recording = run(load(name, overrides), options).recording
    for at in random.Random(name).sample(range(141, 600), 4):
        found = branch(recording, tmp_path / str(at), at=at, in_process=True)
        assert found.equal, found.result.reason
        assert "plant" in found.restored


@pytest.mark.parametrize(
    "filters",
    [
        ["velocity=filtered", "cutoff_hz=20", "smoothing=low_pass", "time_constant=0.02"],
        ["velocity=finite_difference", "smoothing=moving_average", "window=5"],
    ],
)
def test_filters_of_the_controller_are_saved(filters, tmp_path):
    noise = ["plant.params.noise={position: 0.001, velocity: 0.01}"]
    overrides = [*noise, *(f"controller.params.{text}" for text in filters)]
    scenario = load("two_link/pid", ["duration=500ms", "checkpoint=200ms", *overrides])
    recording = run(scenario, Options(out=tmp_path / "a", host=InProcess())).recording
    found = branch(recording, tmp_path / "b", at=70, in_process=True)
    assert found.equal, found.result.reason
    assert set(found.restored.values()) == {40}


def test_without_checkpoints_it_is_the_same(saved, tmp_path):
    found = branch(saved, tmp_path / "b", at=250, checkpoints=False, in_process=True)
    assert found.equal
    assert found.restored == {}


def test_without_any_sound_state_all_start_at_0(copy, tmp_path):
    for path in (copy.parent / "checkpoints").glob("*.*00"):
        path.unlink()
    found = branch(copy, tmp_path / "b", at=250, in_process=True)
    assert found.equal
    assert found.restored == {}
