"""Where and when the kernel lets the threads of a process run, on Linux; it changes no result."""

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path

_CORE = 36
"""Where /proc/<pid>/stat has the core, behind the name (proc_pid_stat(5))."""


@dataclass(frozen=True)
class Place:
    """Where threads run.

    core: the only one they run on; None: all that are ours. yields: a thread that wakes up waits
    until the one that runs there sleeps, or its time is over (SCHED_BATCH of sched(7)).
    """

    core: int | None = None
    yields: bool = False


def core_of(pid: int) -> int | None:
    """Return the core a process has run on last.

    None where it is not to be moved: there is one core only, or it has chosen cores or a policy.
    """
    ours = os.sched_getaffinity(0)
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        is_free = os.sched_getaffinity(pid) == ours and _is_common(pid)
    except OSError:
        return None
    return int(fields[_CORE]) if is_free and len(ours) > 1 else None


def place_threads(pid: int, place: Place) -> None:
    """Place all threads of a process; what it starts from now on runs as they do."""
    cores = os.sched_getaffinity(0) if place.core is None else {place.core}
    policy = os.SCHED_BATCH if place.yields else os.SCHED_OTHER
    # Each thread may have ended meanwhile, and so may the process.
    with contextlib.suppress(OSError):
        for name in os.listdir(f"/proc/{pid}/task"):  # noqa: PTH208  (a path each takes longer)
            thread = int(name)
            if _is_common(thread):
                os.sched_setaffinity(thread, cores)
                os.sched_setscheduler(thread, policy, os.sched_param(0))


def _is_common(thread: int) -> bool:
    """Return whether a thread has the policy of all, and not one for real time, for example."""
    return os.sched_getscheduler(thread) in {os.SCHED_OTHER, os.SCHED_BATCH}
