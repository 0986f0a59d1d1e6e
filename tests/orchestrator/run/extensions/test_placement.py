"""Participants that wait for each other share a core while that is faster."""

import os
import sys
from pathlib import Path

import pytest

from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.run.extensions.placement import in_cycles, place
from stepbus_orchestrator.scenario.load import load


def test_only_those_that_wait_for_themselves_take_turns():
    assert in_cycles(load("two_link")) == ["plant", "controller"]


@pytest.mark.skipif(
    sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2, reason="takes two cores of Linux"
)
def test_a_process_is_kept_with_all_its_threads(tmp_path):
    child = start(
        tmp_path,
        "import threading; threading.Thread(target=threading.Event().wait, daemon=True).start()",
    )
    everywhere = os.sched_getaffinity(0)
    try:
        place(child.pid, {max(everywhere)}, waits=True)
        assert [os.sched_getaffinity(it) for it in threads(child)] == [{max(everywhere)}] * 2
        assert {os.sched_getscheduler(it) for it in threads(child)} == {os.SCHED_BATCH}
        place(child.pid, everywhere, waits=False)
        assert [os.sched_getaffinity(it) for it in threads(child)] == [everywhere] * 2
        assert {os.sched_getscheduler(it) for it in threads(child)} == {os.SCHED_OTHER}
        (chosen, *_) = threads(child)
        os.sched_setscheduler(chosen, os.SCHED_IDLE, os.sched_param(0))
        place(child.pid, everywhere, waits=True)
        assert os.sched_getscheduler(chosen) == os.SCHED_IDLE
    finally:
        child.end(0.0)
    place(child.pid, everywhere, waits=False)


def start(folder, code):
    program = f"{code}\nprint('up', flush=True)\nimport time\ntime.sleep(600)"
    log = folder / "child.log"
    child = Child(
        "plant", [sys.executable, "-c", program], cwd=folder, log=log, environment=dict(os.environ)
    )
    while "up" not in log.read_text():
        assert child.exit_code() is None
    return child


def threads(child):
    return [int(thread.name) for thread in Path(f"/proc/{child.pid}/task").iterdir()]
