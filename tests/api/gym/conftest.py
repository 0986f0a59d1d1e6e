"""What the tests of environments share."""

import os
import signal
import sys
import threading
from pathlib import Path

import pytest

gymnasium = pytest.importorskip("gymnasium")


@pytest.fixture(autouse=True)
def process_is_left_as_it_was(own_temp):
    def state():
        signals = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGURG)]
        return Path.cwd(), list(sys.path), list(sys.argv), sys.stdout, os._exit, signals

    before, threads = state(), threading.active_count()
    main = sys.modules["__main__"]
    yield
    assert state() == before
    assert sys.modules["__main__"] is main
    assert threading.active_count() == threads
    assert list(own_temp.iterdir()) == []
