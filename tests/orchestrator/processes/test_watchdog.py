"""A watchdog kills until a blocked call is free, and counts no time that nobody ran."""

import signal
import subprocess
import sys
import threading
import time

from stepbus_orchestrator.processes.watchdog import Watchdog


def test_a_blocked_call_is_freed():
    freed = threading.Event()
    watchdog = Watchdog(0.05, freed.set)
    with watchdog.watching():
        assert freed.wait(30.0)
    watchdog.close()
    assert watchdog.fired


def test_a_kill_that_frees_nothing_is_followed_by_another():
    killed = threading.Semaphore(0)
    watchdog = Watchdog(0.05, killed.release)
    with watchdog.watching():
        assert killed.acquire(timeout=30.0)
        assert killed.acquire(timeout=30.0)
    watchdog.close()


def test_each_blocked_call_has_its_own_kill():
    killed = threading.Semaphore(0)
    watchdog = Watchdog(0.05, killed.release)
    for _ in range(2):
        with watchdog.watching():
            assert killed.acquire(timeout=30.0)
    watchdog.close()


WATCHED = """
from stepbus_orchestrator.processes.watchdog import Watchdog
watchdog = Watchdog(1.0, lambda: None)
with watchdog.watching():
    print("watching", flush=True)
    input()
watchdog.close()
print(watchdog.fired)
"""


def test_the_time_in_which_the_orchestrator_was_stopped_does_not_count():
    process = subprocess.Popen(
        [sys.executable, "-c", WATCHED], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "watching\n"
    process.send_signal(signal.SIGSTOP)
    time.sleep(2.0)
    process.send_signal(signal.SIGCONT)
    time.sleep(0.3)  # So that it is checked before the call ends.
    assert process.communicate("\n", timeout=30)[0] == "False\n"
