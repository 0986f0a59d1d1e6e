"""A watchdog kills until a blocked call is free, and counts no time that nobody ran."""

import threading

from support.surroundings import comes_true

from stepbus_orchestrator.processes.watchdog import Watchdog


def test_a_blocked_call_is_freed_by_a_kill_or_where_that_frees_nothing_another():
    killed = threading.Semaphore(0)
    watchdog = Watchdog(0.05, killed.release)
    for _ in range(2):
        with watchdog.watching():
            assert killed.acquire(timeout=30.0)
            assert killed.acquire(timeout=30.0)
    watchdog.close()


class Clock:
    """A clock that stands still until it is moved. reads: how often it was read."""

    def __init__(self):
        self.now, self.reads = 0.0, 0

    def monotonic(self):
        self.reads += 1
        return self.now


def test_the_time_in_which_the_orchestrator_was_stopped_does_not_count():
    clock, killed = Clock(), threading.Event()
    watchdog = Watchdog(1.0, killed.set, clock)
    with watchdog.watching():
        for _ in range(4):  # One check counts for a quarter of a second, however long it took.
            assert comes_true(lambda before=clock.reads: clock.reads > before + 1)
            assert not killed.is_set()
            clock.now += 100.0
        assert comes_true(lambda before=clock.reads: clock.reads > before + 1)
        clock.now += 100.0
        assert killed.wait(timeout=30.0)
    watchdog.close()
