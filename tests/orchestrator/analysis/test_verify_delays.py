"""Delays stop every participant again and again, and let it go."""

import sys
import time

import psutil
import pytest

from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.processes.delays import Delays


@pytest.fixture
def start(tmp_path):
    """Return a function that starts a busy process."""
    children = []

    def begin(name):
        command = [sys.executable, "-c", "while True: pass"]
        child = Child(name, command, cwd=tmp_path, log=tmp_path / name, environment={})
        children.append(child)
        return child

    yield begin
    for child in children:
        child.end()


@pytest.fixture
def child(start):
    return start("busy")


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


def test_a_process_that_has_ended_is_left_alone(child, start):
    child.end()
    delays = Delays(["busy", "other"], (0, 0))
    with delays.around({"busy": child, "other": start("other")}):
        wait_until(lambda: delays.counts["other"] > 5)
    assert delays.counts["busy"] == 0
