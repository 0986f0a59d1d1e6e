"""What ends an orchestrator from outside: Ctrl-C, kill -9, a full disk."""

import json
import signal
import subprocess
import sys

import psutil
import pytest
from support.runs.joints import leftovers, write_scenario
from support.surroundings import answers, comes_true

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording


@pytest.fixture
def start(tmp_path):
    """Return a function that starts `stepbus run` and waits for the first steps."""
    processes = []

    def begin(*options, kilobytes=None):
        path = write_scenario(tmp_path / "source")
        command = [sys.executable, "-m", "stepbus_orchestrator.cli", "run", path, "--no-report"]
        # What a file may grow to; a write beyond it fails as it does on a full disk.
        # POSIX counts it in blocks of 512 bytes; bash, unless it is called sh, in kilobytes.
        limit = f"ulimit -f {2 * kilobytes}; trap '' XFSZ; " if kilobytes else ""
        shell = ["sh", "-c", f'{limit}exec "$@"', "sh"]
        process = subprocess.Popen(
            [*shell, *command, "--out", tmp_path / "out", *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        return process

    yield begin
    for process in processes:
        process.kill()
        process.wait()
        process.stdout.close()
        process.stderr.close()


def recorded_bytes(tmp_path):
    path = tmp_path / "out" / "run.mcap"
    return path.stat().st_size if path.exists() else 0


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGINT,
        pytest.param(signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param(signal.SIGHUP, marks=pytest.mark.slow),
    ],
)
def test_a_signal_ends_the_run_cleanly_with_its_own_code(tmp_path, start, number):
    process = start("--set", "duration=1000s")
    assert comes_true(lambda: recorded_bytes(tmp_path) > 20_000)
    process.send_signal(number)
    _, errors = process.communicate(timeout=20)
    assert (process.returncode, "interrupted by the user" in errors) == (ExitCode.INTERRUPTED, True)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["exit_code"] == ExitCode.INTERRUPTED
    recording = Recording(tmp_path / "out" / "run.mcap")
    assert recording.damage == ""
    assert len(recording["plant/joint_state"]) >= result["steps"] > 0


def test_a_killed_orchestrator_leaves_no_process_and_no_folder(tmp_path, own_temp, start):
    process = start("--set", "duration=1000s")
    assert comes_true(lambda: recorded_bytes(tmp_path) > 100_000)
    process.kill()
    process.wait()
    assert comes_true(lambda: leftovers(tmp_path) == [])
    assert comes_true(lambda: list(own_temp.iterdir()) == [])
    recording = Recording(tmp_path / "out" / "run.mcap")
    assert len(recording["plant/joint_state"]) > 0


def test_a_full_disk_ends_the_run_with_one_sentence_and_a_whole_recording(tmp_path, start):
    process = start("--set", "duration=1000s", kilobytes=600)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == ExitCode.RECORDING
    assert "raise the file size limit (ulimit -f)" in errors
    assert "Traceback" not in errors
    recording = Recording(tmp_path / "out" / "run.mcap")
    assert len(recording["plant/joint_state"]) > 1000


@pytest.mark.slow
@pytest.mark.parametrize("ending", [[], [signal.SIGINT]])
def test_nobody_waits_for_those_that_are_stopped_once_the_run_has_failed(tmp_path, start, ending):
    stop = [f"{name}.stop_timeout=10min" for name in ("plant", "controller", "mission")]
    deadline = "60s" if ending else "3s"
    step = [f"{name}.step_timeout={deadline}" for name in ("plant", "controller", "mission")]
    process = start(
        "--set", "duration=1000s", *(w for item in stop + step for w in ("--set", item))
    )
    assert comes_true(lambda: recorded_bytes(tmp_path) > 20_000)
    for child, said in answers(
        psutil.Process(process.pid).children(), psutil.Process.cmdline
    ).items():
        if any(word.startswith("joints.py:") for word in said):
            child.suspend()
    for number in ending:
        process.send_signal(number)
    _, errors = process.communicate(timeout=40)
    assert process.returncode == (ExitCode.INTERRUPTED if ending else ExitCode.STEP_TIMEOUT)
    assert ending or "stopped by a signal or a debugger" in errors
    assert leftovers(tmp_path) == []
