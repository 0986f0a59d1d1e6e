"""What the tests of runs in one process share."""

import os
import signal
import sys
import threading
from pathlib import Path

import pytest
from support.runs.bridge import processes_in
from support.runs.joints import run_joints


@pytest.fixture(autouse=True)
def surroundings_are_restored(tmp_path, own_temp):
    before = (
        Path.cwd(),
        list(sys.path),
        list(sys.argv),
        sys.stdout,
        sys.modules["__main__"],
        os._exit,
    )
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGURG)}
    threads = threading.active_count()
    yield
    assert before == (Path.cwd(), sys.path, sys.argv, sys.stdout, sys.modules["__main__"], os._exit)
    assert handlers == {number: signal.getsignal(number) for number in handlers}
    assert threading.active_count() == threads
    assert processes_in(tmp_path) == []
    assert list(own_temp.iterdir()) == []


@pytest.fixture(scope="module")
def separate(tmp_path_factory):
    """The run of the same scenario with processes."""
    return run_joints(tmp_path_factory.mktemp("separate"))
