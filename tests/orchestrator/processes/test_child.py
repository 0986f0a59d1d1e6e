"""A participant's process: no signal reaches anybody else, and its end is seen."""

import os
import signal
import sys
from pathlib import Path

import psutil
import pytest
from support.surroundings import comes_true, has_ended

from stepbus_orchestrator.processes.activity import Activity
from stepbus_orchestrator.processes.child import Child


@pytest.fixture
def start(tmp_path):
    """Return a function that starts a Python program as a participant."""
    children = []

    def begin(code):
        command = [sys.executable, "-c", code]
        child = Child("one", command, cwd=tmp_path, log=tmp_path / "log", environment=os.environ)
        children.append(child)
        return child

    yield begin
    for child in children:
        child.end()


def test_no_group_is_signalled_after_its_leader_was_reaped(start, monkeypatch):
    child = start("")
    assert child.wait(20.0)
    leaders = []

    def killpg(group, number):
        leaders.append(Path(f"/proc/{group}").exists())

    monkeypatch.setattr(os, "killpg", killpg)
    assert child.exit_code() == 0
    child.end()
    child.signal(signal.SIGKILL)
    assert leaders == [True]


def test_what_a_process_has_started_ends_with_it(start, tmp_path):
    child = start(
        "import subprocess, sys; print(subprocess.Popen(['sleep', '1000']).pid, flush=True)"
    )
    assert child.wait(20.0)
    sleeper = psutil.Process(int((tmp_path / "log").read_text()))
    child.end()
    assert comes_true(lambda: has_ended(sleeper))
    assert child.exit_code() == 0


def test_a_process_that_is_asked_to_end_is_asked_once(start, tmp_path):
    child = start(
        "import signal\n"
        "signal.signal(signal.SIGTERM, lambda *_: print('asked', flush=True))\n"
        "print('ready', flush=True)\n"
        "while True: signal.pause()"
    )
    log = tmp_path / "log"
    assert comes_true(lambda: log.read_text() == "ready\n")
    child.terminate()
    assert comes_true(lambda: log.read_text() == "ready\nasked\n")
    child.end(0.3)
    assert log.read_text() == "ready\nasked\n"
    assert child.exit_code() == -signal.SIGKILL


@pytest.mark.parametrize(
    ("code", "exit_code", "sentence"),
    [
        ("raise SystemExit(3)", 3, "exited with code 3"),
        ("import os; os.kill(os.getpid(), 9)", -9, "was killed by SIGKILL"),
    ],
)
def test_the_exit_code_stays_after_the_end(start, code, exit_code, sentence):
    child = start(code)
    assert child.wait(20.0)
    assert child.exit_code() == exit_code
    child.end()
    assert (child.exit_code(), child.how_it_ended()) == (exit_code, sentence)


@pytest.mark.parametrize(
    ("activity", "sentence"),
    [
        (Activity(is_stopped=True, cpu_s=9), "`kill -CONT -7`"),
        (Activity(cpu_s=4.0), "it has computed for 4.0 s"),
        (Activity(cpu_s=0.2), ""),
    ],
)
def test_what_a_process_does_is_a_reason(activity, sentence):
    reason = activity.reason(-7, 10.0)
    assert sentence in reason
    assert bool(sentence) == bool(reason)
