"""Faults on purpose in real runs; `make chaos` has two hundred of them."""

import re

import pytest
from support.messages.recordings import messages, metadata
from support.runs.joints import PROGRAM, run_joints, write_scenario
from support.runs.large import write_large

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.replay.rerun import Preparation
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

NAMES = ("plant", "controller", "mission")
FAST = [f"{name}.step_timeout=2s" for name in NAMES]
"""For those runs in which somebody misses a deadline."""
TEN_SECONDS = [f"{name}.{what}_timeout=10s" for name in NAMES for what in ("step", "stop")]
PATIENT = [f"{name}.step_timeout=30s" for name in NAMES]


pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("nothing_is_left")]


def run_with(folder, *faults, overrides=PATIENT):
    scenario = load(write_scenario(folder / "source"), overrides, faults)
    return run(scenario, Options(out=folder / "out"))


def test_faults_that_only_take_time_change_no_message(tmp_path):
    plain = run_joints(tmp_path / "plain", in_process=True)
    faults = (
        "delay plant at 20 for 30ms",
        "duplicate controller at 30",
        "freeze mission at 40 for 100ms",
        "slow controller at 50 for 100ms",
    )
    result = run_with(tmp_path / "faulty", *faults)
    assert (result.exit_code, result.reason) == (0, "finished")
    assert messages(result.recording) == messages(plain.recording)
    assert sorted(result.faults) == sorted(faults)
    assert list(metadata(result.recording)["faults"].values()) == list(faults)


class Sentences(Observer):
    def __init__(self):
        self.said = []

    def event(self, level, who, step, text):
        self.said.append((level, who, step, text))


@pytest.mark.parametrize(
    ("fault", "who", "step"),
    [
        ("drop plant at 50", "plant", 50),
        ("corrupt controller at 7", "controller", 7),
        pytest.param("oversize plant at 20", "plant", 20, marks=pytest.mark.slow),
        pytest.param("drop mission at 96", "mission", 96, marks=pytest.mark.slow),
        pytest.param("drop plant at 0", "plant", 0, marks=pytest.mark.slow),
        ("drop controller at 99", "controller", 99),
    ],
)
def test_a_message_that_is_lost_is_published_again(tmp_path, fault, who, step):
    plain = run_joints(tmp_path / "plain", in_process=True)
    observer = Sentences()
    scenario = load(write_scenario(tmp_path / "source"), TEN_SECONDS, [fault])
    result = run(scenario, Options(out=tmp_path / "out"), observer)
    assert (result.exit_code, result.reason) == (0, "finished")
    assert messages(result.recording) == messages(plain.recording)
    again = [row for row in observer.said if row[3].endswith("lost, and is published again")]
    assert {row[:3] for row in again} == {("warning", who, step)}


def test_what_its_source_is_ahead_of_is_a_skipped_step(tmp_path):
    result = run_with(tmp_path, "drop mission at 40", overrides=[*PATIENT, "window=16"])
    assert (result.exit_code, result.participant) == (ExitCode.FAULT, "mission")
    assert "from step 36 to 44 (expected 40)" in result.reason


@pytest.mark.parametrize(
    ("fault", "code", "sentence"),
    [
        ("kill plant at 33", ExitCode.DIED, r"step 33 .*: plant \(pid \d+\) was killed by SIGKILL"),
        ("crash controller at 0", ExitCode.DIED, r"step 0 .*: controller .* killed by SIGSEGV"),
        ("freeze mission at 40", ExitCode.STEP_TIMEOUT, r"step 40 .*: mission .* stopped by a signal"),
        ("reorder mission at 48", ExitCode.FAULT, r"step \d+ .*mission skipped from step 44 to 52 \(expected 48\)"),
    ],
)  # fmt: skip
def test_other_faults_end_the_run_and_name_whom_they_hit_and_when(tmp_path, fault, code, sentence):
    overrides = FAST if code == ExitCode.STEP_TIMEOUT else PATIENT
    result = run_with(tmp_path, fault, overrides=overrides)
    assert result.exit_code == code
    assert re.search(sentence, result.reason)
    assert list(result.faults) == [fault]


def test_a_held_participant_is_replaced_by_its_last_and_then_a_safe_command(tmp_path):
    hold = "controller.on_fault={keep: 20ms, hold: 100ms}"
    result = run_with(tmp_path, "kill controller at 40", overrides=[*PATIENT, hold])
    died = (result.exit_code, result.participant, result.at_step)
    assert died == (ExitCode.DIED, "controller", 40)
    assert "held from step 40 to 64" in result.reason
    commands = [
        data for topic, _, _, data in messages(result.recording) if topic == "controller/command"
    ]
    assert commands[39:44] == [commands[39]] * 5
    assert set(commands[44:]) == {
        b"\x82\xa4mode\xa5brake\xa6values\x92" + b"\xcb" + bytes(8) + b"\xcb" + bytes(8)
    }
    assert (len(commands), result.steps) == (64, 64)


def test_a_held_run_is_run_again_from_its_log_byte_for_byte(tmp_path):
    hold = "controller.on_fault={hold: 50ms, safe: {command: {mode: torque, values: [0, 1]}}}"
    result = run_with(tmp_path, "kill controller at 20", overrides=[*PATIENT, hold])
    assert Preparation(result.recording, tmp_path / "again").run().equal


def test_who_found_a_broken_message_has_ended_so_nobody_can_be_held(tmp_path):
    overrides = [*PATIENT, "mission.on_fault=hold"]
    result = run_with(tmp_path, "reorder mission at 48", overrides=overrides)
    assert (result.exit_code, result.participant) == (ExitCode.FAULT, "mission")
    assert "held" not in result.reason


def test_message_faults_of_a_program_without_our_library_are_refused(tmp_path):
    program = "controller.exec=[python, by_the_page.py]"
    source = tmp_path / "source"
    write_scenario(source)
    (source / "by_the_page.py").write_bytes(PROGRAM.with_name("by_the_page.py").read_bytes())
    scenario = load(source / "scenario.yaml", [*PATIENT, program], ["drop controller at 3"])
    result = run(scenario, Options(out=tmp_path / "out"))
    assert result.exit_code == ExitCode.START
    assert "the fault 'drop controller at 3' needs" in result.reason


@pytest.mark.parametrize("step", [0, 10])
def test_large_messages_to_a_frozen_participant_hang_nobody_and_it_is_blamed(tmp_path, step):
    overrides = ["mission.step_timeout=500ms", "reader.step_timeout=1s"]
    scenario = load(write_large(tmp_path), overrides, [f"freeze reader at {step}"])
    result = run(scenario, Options(out=tmp_path / "out"))
    late = (result.exit_code, result.participant, result.at_step)
    assert late == (ExitCode.STEP_TIMEOUT, "reader", step)


@pytest.mark.slow
@pytest.mark.parametrize("window", [pytest.param(1, marks=pytest.mark.slow), 64])
def test_a_frozen_participant_is_held_with_the_same_result_in_every_window(tmp_path, window):
    overrides = [*FAST, "controller.on_fault=hold", f"window={window}"]
    hashes = {
        run_with(tmp_path / fault.split()[0], fault, overrides=overrides).steps
        for fault in ("freeze controller at 30", "kill controller at 30")
    }
    assert hashes == {100}
