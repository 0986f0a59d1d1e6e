"""Lets the runs in one process that are in several threads go on one at a time.

Prints, working directory, modules and handlers of signals are the process's.
"""

import contextlib
import os
import threading
from collections.abc import Iterator

from stepbus_orchestrator.errors import Interrupted

_TICK_S = 0.1
_lock = threading.RLock()


@contextlib.contextmanager
def alone(interrupt: threading.Event) -> Iterator[None]:
    """Wait until no run of another thread goes on, and keep it so for a block.

    Raises Interrupted where that is set meanwhile.
    """
    lock = _lock
    while not lock.acquire(timeout=_TICK_S):
        if interrupt.is_set():
            raise Interrupted("interrupted while the run of another thread went on")
    try:
        yield
    finally:
        lock.release()


def _begin_anew() -> None:
    global _lock  # noqa: PLW0603  (the thread that has it is not in this copy of the process)
    _lock = threading.RLock()


os.register_at_fork(after_in_child=_begin_anew)
