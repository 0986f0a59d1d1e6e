"""A bridged participant in a run, with real processes: it works, fails with one sentence, and goes."""

import os
import re
import signal
import subprocess
import sys
import time

import psutil
import pytest
from support.runs.bridge import run_bridged, write_bridged
from support.surroundings import comes_true, has_ended

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run import run
from stepbus_orchestrator.run.extension import RunExtension

pytestmark = pytest.mark.usefixtures("nothing_is_left")


def commands(result):
    return [entry.data for entry in Recording(result.recording)["controller/command"].entries()]


LOGGED = {
    "json": "['hip', 'knee']",
    "msgpack": "['hip', 'knee']",
    "raw": "(2.0, 0.005, 1.0, 0.0, 16.0, 3.0, ",
}


@pytest.mark.slow
def test_the_format_changes_no_byte_of_what_is_recorded_and_prints_go_to_the_log(tmp_path):
    recorded = []
    for form, line in LOGGED.items():
        result = run_bridged(tmp_path / form, form)
        assert (result.exit_code, result.steps) == (0, 100), result.reason
        assert line in (tmp_path / form / "out/logs/controller.log").read_text()
        recorded.append(commands(result))
    assert recorded[0] == recorded[1] == recorded[2]


@pytest.mark.parametrize(
    ("form", "kind", "code", "sentence"),
    [
        ("json", "raise", ExitCode.FAULT, r"step 7 \(t = 0\.035 s\): controller \(pid \d+\): python\S* .*\(pid \d+\) exited with code 3; its last output: \".*error: the knee is jammed"),
        pytest.param("msgpack", "child", ExitCode.STEP_TIMEOUT, r"step 7 .*: controller \(pid \d+\) has been waiting for `python bridged\.py msgpack child 7` for \d+\.\d s; .*and flush the answer\?", marks=pytest.mark.slow),
        ("json", "long", ExitCode.FAULT, r"step 7.*exceed the bus's limit"),
    ],
)  # fmt: skip
def test_what_the_program_does_wrong_is_blamed_with_its_step(tmp_path, form, kind, code, sentence):
    result = run_bridged(tmp_path, form, kind)
    assert (result.exit_code, result.participant) == (code, "controller")
    assert re.search(sentence, result.reason)


class Plots(RunExtension):
    """Lets the program end once it has left the run."""

    def __init__(self, folder):
        self.plotted = folder / "source/plotted"

    def awaiting(self, participants):
        for one in participants:
            if one.name == "controller" and one.has_left:
                assert one.process.exit_code() is None
                self.plotted.touch()


def test_a_program_that_works_on_behind_the_last_step_has_left_the_run(tmp_path):
    plots = Plots(tmp_path)
    result = run_bridged(tmp_path, "json", "plot", extensions=[plots])
    assert (result.exit_code, result.warnings, plots.plotted.exists()) == (0, [], True)


@pytest.mark.slow
def test_a_program_that_works_on_without_end_is_late(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "_OWN_WORK_S", 0.0)
    result = run_bridged(tmp_path, "json", "plot", 7, "controller.stop_timeout=10s")
    assert (result.exit_code, result.participant) == (ExitCode.STOP_TIMEOUT, "controller")
    assert "did not end within 10 s of the stop and was killed" in result.reason


def test_a_program_that_ends_before_it_is_ready_is_blamed(tmp_path):
    result = run_bridged(tmp_path, "json", "raise", -1)
    assert (result.exit_code, result.participant) == (ExitCode.START, "controller")
    assert re.search(".* exited with code 3; its last output", result.reason)


def test_an_exit_code_after_the_stop_is_an_error(tmp_path):
    result = run_bridged(tmp_path, "json", "code")
    assert (result.exit_code, result.participant) == (ExitCode.DIED, "controller")
    assert "exited with code 3 after the stop" in (tmp_path / "out/logs/controller.log").read_text()


RUN = """
import sys
import stepbus
stepbus.run(sys.argv[1], out=sys.argv[2])
"""


def bridged_program(folder):
    """Wait until the program behind the bridge hangs, and return its process."""
    file = folder / "source/pid"
    while not file.exists() or not file.read_text().endswith(";"):
        time.sleep(0.05)
    return psutil.Process(int(file.read_text()[:-1]))


@pytest.mark.parametrize("who", ["orchestrator", "bridge"])
def test_a_program_does_not_outlive_a_killed_orchestrator_or_bridge(tmp_path, who):
    path = write_bridged(tmp_path / "source", "json", "hang", 0)
    words = [sys.executable, "-c", RUN, str(path), str(tmp_path / "out")]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
        program = bridged_program(tmp_path)
        os.kill(run.pid if who == "orchestrator" else program.ppid(), signal.SIGKILL)
        run.wait(timeout=30)
        assert comes_true(lambda: has_ended(program))
