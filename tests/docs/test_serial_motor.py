"""The example with a serial port: a pseudo-terminal stands for the hardware."""

import shutil
import subprocess
import sys

import pytest
from support.paths import CHECKOUT

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.replay import replay
from stepbus_orchestrator.run.extensions.real_time import RealTime
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load


@pytest.fixture
def example(tmp_path):
    return shutil.copytree(CHECKOUT / "examples/serial_motor", tmp_path / "serial_motor")


@pytest.fixture
def drive(example):
    """The process that stands for the drive, with its port `motor.tty`."""
    program = [sys.executable, "drive.py", "motor.tty"]
    with subprocess.Popen(program, cwd=example, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "a motor at motor.tty\n"
        yield process
        process.kill()


def run_example(example, out, *overrides, **options):
    checked = load(example, ["duration=500ms", "motor.step_timeout=60s", *overrides])
    return run(checked, Options(out=out, host=InProcess(), **options))


@pytest.mark.slow
def test_the_recording_is_the_same_in_real_time_and_needs_no_hardware_afterwards(
    example, drive, tmp_path
):
    patient = "motor.params.timeout=60s"
    first = run_example(example, tmp_path / "a", patient)
    second = run_example(example, tmp_path / "b", patient, extensions=[RealTime(10_000_000, 5.0)])
    assert first.exit_code == second.exit_code == 0, first.reason + second.reason
    assert first.sha256 == second.sha256
    drive.kill()
    drive.wait()
    assert replay(first.recording, "controller", recorded=True).equal


def test_a_motor_that_is_off_is_named(example, tmp_path):
    result = run_example(example, tmp_path / "a")
    assert result.exit_code == ExitCode.START
    assert result.participant == "motor"
    assert "is the motor on?" in result.reason


def test_a_motor_that_answers_nothing_is_named(example, tmp_path):
    mute = "import os, sys, time; a, b = os.openpty(); print(os.ttyname(b), flush=True); time.sleep(60)"
    program = [sys.executable, "-c", mute]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as process:
        port = process.stdout.readline().strip()
        overrides = [f"motor.params.port={port}", "motor.params.timeout=500ms"]
        result = run_example(example, tmp_path / "a", *overrides)
        process.kill()
    assert result.exit_code == ExitCode.START
    assert "0 of 15 bytes within 0.5 s" in result.reason
