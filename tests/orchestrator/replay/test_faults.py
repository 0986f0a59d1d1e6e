"""A participant that fails in a replay is blamed in one sentence, and nothing is left of it."""

import re
import sys

import pytest
from support.runs.joints import fault, run_joints
from support.runs.large import write_large

from stepbus_orchestrator.errors import ExitCode, RecordingFailed, RunFailure, StepTimeout
from stepbus_orchestrator.replay import replay
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

STEP = "controller.step_timeout=2s"
READY = "controller.ready_timeout=500ms"
SPAWN = "controller.spawn_timeout=500ms"
NEVER_JOINS = [sys.executable, "-c", "import time; time.sleep(100)"]


@pytest.fixture(scope="module")
def joints_recording(tmp_path_factory):
    result = run_joints(tmp_path_factory.mktemp("joints"), in_process=True)
    assert result.exit_code == 0, result.reason
    return result.recording


pytestmark = pytest.mark.usefixtures("left_as_found")


def failure_of(recording, *overrides, **options):
    with pytest.raises(RunFailure) as caught:
        replay(recording, "controller", set=overrides, **options)
    return caught.value


@pytest.mark.parametrize(
    ("kind", "code", "sentence"),
    [
        ("raise", ExitCode.FAULT, r"step 7 \(t = 0\.035 s\): controller \(pid \d+\): ValueError: the knee"),
        ("kill", ExitCode.DIED, r"step 7 .*: controller \(pid \d+\) was killed by SIGKILL"),
        ("hang", ExitCode.STEP_TIMEOUT, r"step 7 .*: controller \(pid \d+\) has been computing for \d+\.\d s; all inputs have arrived; deadline 2 s"),
        ("skip", ExitCode.FAULT, r"step 7 .*reported step 8 instead"),
    ],
)  # fmt: skip
def test_a_fault_in_a_step_is_blamed_with_its_step(joints_recording, kind, code, sentence):
    deadlines = [STEP] if code == ExitCode.STEP_TIMEOUT else []
    failure = failure_of(joints_recording, fault("controller", kind, 7), *deadlines)
    assert (failure.code, failure.participant, failure.step) == (code, "controller", 7)
    assert re.search(sentence, str(failure))


@pytest.mark.parametrize(
    ("changes", "options", "sentence"),
    [
        ([fault("controller", "raise", -1)], {}, r"before the first step: controller \(pid \d+\): ValueError: the knee"),
        ([fault("controller", "hang", -1), READY], {}, r"has joined and is not ready.*0\.5 s \(participants\.controller\.ready_timeout\)"),
        ([SPAWN], {"program": NEVER_JOINS}, "has not reached the bus"),
    ],
)  # fmt: skip
def test_a_fault_before_the_first_step_is_blamed(joints_recording, changes, options, sentence):
    failure = failure_of(joints_recording, *changes, **options)
    assert (failure.code, failure.participant) == (ExitCode.START, "controller")
    assert re.search(sentence, str(failure))


def test_a_recording_without_a_step_is_no_test_that_passes(tmp_path):
    first = fault("controller", "raise", 0)
    recording = run_joints(tmp_path, first, in_process=True).recording
    with pytest.raises(RecordingFailed, match="no complete step of plant"):
        replay(recording, "plant")


def test_a_failed_replay_leaves_no_new_reference(joints_recording, tmp_path):
    failure_of(joints_recording, fault("controller", "exit", 7), update=tmp_path / "new.mcap")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_frozen_participant_that_large_messages_pile_up_for_hangs_nobody(tmp_path, own_temp):
    recording = run(
        load(write_large(tmp_path)), Options(out=tmp_path / "out", host=InProcess())
    ).recording
    with pytest.raises(
        StepTimeout, match=r"reader \(pid \d+\) has read no messages for .* queued up"
    ):
        replay(recording, "reader", set=["reader.step_timeout=1s", "reader.params={frozen: true}"])
    assert replay(recording, "reader").equal
