"""Pause, single steps and debugging: no effect on the result."""

import io
import os
import pty
import subprocess
import sys
import threading
import time
from unittest import mock

import pytest
from support.messages.recordings import messages
from support.runs.joints import fault, leftovers, write_scenario

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.cli.terminal.keys import press
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.recorded import recorded_end
from stepbus_orchestrator.run.extensions.debug import Debug
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.hosts import InProcess, Processes
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load


def test_keys_steer_the_pace():
    pace, interrupt = Pace(), threading.Event()
    pace.attach(mock.Mock(**{"state.end": None, "state.last_step": 5}))
    limits = []
    for key in "ps p\nx":
        press(key, pace, interrupt)
        limits.append(pace.limit(4))
    assert limits == [4, 5, FAR, 4, 5, 5]
    press("q", pace, interrupt)
    assert (pace.is_stopping, interrupt.is_set()) == (True, False)
    press("q", pace, interrupt)
    assert interrupt.is_set()


class Stops(Observer):
    """Ends the run as the user does, once it has come so far."""

    def __init__(self, pace, at):
        self.pace = pace
        self.at = at

    def progress(self, progress):
        if progress.step >= self.at:
            self.pace.stop()


@pytest.mark.parametrize("host", [Processes(), InProcess()])
@pytest.mark.parametrize("pause_at", [None, 0, 30])
def test_a_run_that_its_user_ends_has_finished(tmp_path, host, pause_at):
    scenario = load(write_scenario(tmp_path / "source"), ["duration=1000s"])
    pace = Pace(pause_at)
    options = Options(out=tmp_path / "out", host=host, extensions=[pace])
    result = run(scenario, options, Stops(pace, at=1 if pause_at is None else pause_at))
    ending = (result.exit_code, result.outcome, result.reason)
    assert ending == (0, "finished", "stopped by the user")
    assert result.steps == pause_at if pause_at is not None else result.steps > 0
    with Recording(result) as recording:
        assert (recording.flaws(), recording.incomplete) == ([], {})
        assert recorded_end(recording) == result.steps


class Stepper(Observer):
    """Does single steps whenever the run is paused, then lets it go on."""

    def __init__(self, pace):
        self.pace = pace
        self.seen = []

    def progress(self, progress):
        if progress.phase == "paused":
            self.seen.append(progress.step)
            self.pace.step() if len(self.seen) < 4 else self.pace.resume()


@pytest.mark.parametrize("window", [1, 64])
def test_a_run_that_is_paused_and_stepped_has_the_same_recording(tmp_path, window):
    scenario = load(write_scenario(tmp_path / "source"), [f"window={window}"])
    plain = run(scenario, Options(out=tmp_path / "plain", host=InProcess()))
    pace = Pace(30)
    watcher = Stepper(pace)
    result = run(scenario, Options(out=tmp_path / "out", extensions=[pace]), watcher)
    assert watcher.seen == [30, 31, 32, 33]
    assert (result.exit_code, result.sha256) == (0, plain.sha256)


@pytest.mark.slow
def test_a_debugged_participant_has_no_deadline(tmp_path, monkeypatch):
    slow = [fault("controller", "nap", 7), "controller.step_timeout=500ms"]
    scenario = load(write_scenario(tmp_path / "source"), slow)
    late = run(scenario, Options(out=tmp_path / "late"))
    result = run(scenario, Options(out=tmp_path / "out", extensions=[Debug(["controller"])]))
    assert (late.exit_code, result.exit_code) == (6, 0)
    assert "--debug" in (tmp_path / "out/logs/controller.log").read_text()


def test_pausing_needs_somebody_who_can_press_a_key(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    assert main(["run", "two_link", "--pause-at", "3", "--out", str(tmp_path / "out")]) == 2
    assert "--pause-at needs" in capsys.readouterr().err


def read_until(terminal, text, seconds=30.0):
    """Return what a terminal shows until a text is there."""
    shown = ""
    deadline = time.monotonic() + seconds
    while text not in shown and time.monotonic() < deadline:
        try:
            shown += os.read(terminal, 4096).decode(errors="replace")
        except OSError:
            break
    return shown


def test_keys_pressed_at_a_terminal_step_and_resume_a_run(tmp_path, two_link_recording):
    mine, its = pty.openpty()
    command = [sys.executable, "-m", "stepbus_orchestrator.cli", "run", "two_link", "--no-report"]
    process = subprocess.Popen(
        [*command, "--set", "duration=300ms", "--pause-at", "10", "--out", tmp_path / "out"],
        stdin=its,
        stdout=its,
        stderr=its,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "100"},
        start_new_session=True,
    )
    try:
        os.close(its)
        assert "paused before step 10" in read_until(mine, "paused before step 10")
        os.write(mine, b"s")
        assert "paused before step 11" in read_until(mine, "paused before step 11")
        os.write(mine, b"p")
        assert "finished after 60 steps" in read_until(mine, "sha256")
        assert process.wait(20) == 0
    finally:
        process.kill()
        process.wait()
        os.close(mine)
    assert messages(tmp_path / "out/run.mcap") == messages(two_link_recording)
    assert leftovers(tmp_path) == []
