"""What a participant has started in a session of its own does not outlive the run."""

import signal
import subprocess
import sys

import psutil
import pytest
from support.surroundings import comes_true

import stepbus

STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]

LEAVER = """
import os, runpy, sys

mark, sys.argv[1] = sys.argv[1], "stepbus_controller:Controller"
LEFT = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(1000)"

if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        null = os.open(os.devnull, os.O_RDWR)
        for stream in range(3):
            os.dup2(null, stream)
        os.closerange(3, 100)
        os.chdir("/")
        os.execv(sys.executable, [sys.executable, "-S", "-c", LEFT, mark])
    os._exit(0)
os.wait()
runpy.run_module("stepbus_participant", run_name="__main__")
"""
SCENARIO = """
name: leaver
extends: two_link
participants:
  controller:
    exec: [python, leaver.py, MARK]
"""


@pytest.fixture
def scenario(tmp_path):
    """A scenario whose controller leaves a process behind, with the folder's name as argument."""
    (tmp_path / "leaver.py").write_text(LEAVER)
    file = tmp_path / "leaver.yaml"
    file.write_text(SCENARIO.replace("MARK", tmp_path.name))
    yield file
    for process in left_by(tmp_path):
        process.kill()


def left_by(folder):
    """Return the processes that the participant has left behind."""
    found = psutil.process_iter(["cmdline"])
    return [one for one in found if (one.info["cmdline"] or [])[-1:] == [folder.name]]


def test_a_process_in_a_session_of_its_own_is_ended_and_told(tmp_path, scenario):
    result = stepbus.run(scenario, out=tmp_path / "run", set={"duration": "100ms"})
    assert left_by(tmp_path) == []
    assert result.exit_code == 0, result.reason
    (warning,) = result.warnings
    assert warning.source == "controller"
    assert warning.text.startswith("left a process behind")
    assert "import signal, time" in warning.text


def test_it_is_ended_also_where_the_orchestrator_is_killed(tmp_path, scenario):
    command = [*STEPBUS, "run", scenario, "--set", "duration=1h", "--real-time"]
    with subprocess.Popen(
        [*command, "--out", tmp_path / "run"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        try:
            assert comes_true(lambda: left_by(tmp_path))
        finally:
            process.send_signal(signal.SIGKILL)
    assert comes_true(lambda: not left_by(tmp_path))
