"""What this machine has to allow before a run is worth starting."""

import resource

from stepbus_orchestrator.errors import StartFailed

_OWN_FILES = 29
"""Open files of an orchestrator without participants; each of these adds a link."""


def check_limits(participants: int) -> None:
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
