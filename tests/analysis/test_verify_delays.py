"""Delays stop every participant again and again, and let it go."""

import subprocess
import sys
import time

import psutil
import pytest

from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.processes.delays import Delays


@pytest.fixture
def child(tmp_path):
    process = Child(
        "busy",
        [sys.executable, "-c", "while True: pass"],
        cwd=tmp_path,
        log=tmp_path / "log",
        environment={},
    )
    yield process
    process.end()


def wait_until(condition):
    give_up = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.001)


def test_a_process_is_stopped_and_goes_on(child):
    delays, process = Delays(["busy"], (0, 0)), psutil.Process(child.pid)
    with delays.around({"busy": child}):
        wait_until(lambda: process.status() == psutil.STATUS_STOPPED)
        wait_until(lambda: delays.counts["busy"] > 3)
    assert process.status() != psutil.STATUS_STOPPED


def test_every_participant_is_delayed_once_it_is_there(child):
    delays, children = Delays(["busy", "late"], (0, 0)), {}
    with delays.around(children):
        children["busy"] = child
        wait_until(lambda: delays.counts["busy"] > 0)
        children["late"] = child
        wait_until(lambda: delays.counts["late"] > 0)


def test_a_process_that_has_ended_is_left_alone(child):
    child.end()
    delays = Delays(["busy"], (0, 0))
    with delays.around({"busy": child}):
        subprocess.run(["sleep", "0.1"], check=True)
    assert delays.counts == {"busy": 0}
