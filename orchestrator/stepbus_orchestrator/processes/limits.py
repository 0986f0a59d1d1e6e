"""What this machine has to allow before a run is worth starting."""

import mmap
import resource

from stepbus_orchestrator.errors import StartFailed

_OWN_FILES = 21
"""Open files of an orchestrator without participants; each of these adds a link."""

_OWN_MEMORY_BYTES = 1024 << 20
"""Address space that a run takes further: threads, heaps of their own, libraries for numbers."""


def check_limits(participants: int) -> None:
    """Raise StartFailed when a limit is too low for a run of so many participants."""
    _check_open_files(participants)
    _check_memory()


def is_memory_limited() -> bool:
    """Return whether the address space of this process has a limit."""
    return resource.getrlimit(resource.RLIMIT_AS)[0] not in {resource.RLIM_INFINITY, -1}


def _check_memory() -> None:
    """Raise StartFailed when the limit of address space is too low for a run.

    Libraries end the process without a word to us when they get no memory, also after the run.
    """
    if not is_memory_limited():
        return
    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    try:
        mmap.mmap(-1, _OWN_MEMORY_BYTES).close()
    except (OSError, MemoryError, ValueError) as exc:
        raise StartFailed(
            f"a run needs {_OWN_MEMORY_BYTES >> 20} MB of address space on top of what "
            f"is loaded, but this shell allows {allowed >> 20} MB in total; raise the "
            "limit (ulimit -v)"
        ) from exc


def _check_open_files(participants: int) -> None:
    """Raise StartFailed when the limit of open files is too low for so many participants.

    Somewhere in the midst of a start, the system would fail with `Too many open files`.
    """
    needed = _OWN_FILES + participants
    allowed, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if allowed not in {resource.RLIM_INFINITY, -1} and allowed < needed:
        raise StartFailed(
            f"a run of {participants} participant{'s' * (participants > 1)} needs "
            f"{needed} open files, but this shell allows {allowed}; raise the limit with "
            f"`ulimit -n {max(256, 2 * needed)}`"
        )
