"""Follows a run that is going, from before its start to its end."""

import time
from collections.abc import Callable, Iterable
from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Tail, layout
from stepbus_tools.viewing.scene import Latest, Messages

from .link import Link

FRAME_S = 1 / 30
_IDLE_S = 5.0

Turn = Callable[[bool], None]
"""Shows what is new, thirty times a second. It takes whether anything has been recorded since."""


def latest_of(tail: Tail, topics: Iterable[str]) -> Messages:
    """Return the newest message of each port that has one to read."""
    found = {topic: tail.latest(topic) for topic in topics}
    return {t: Latest(step=row[0], message=row[1]) for t, row in found.items() if row}


def follow_run(
    folder: Path,
    is_over: Callable[[], bool],
    begin: Callable[[Tail, Link], Turn],
    start_s: float = 600.0,
) -> bool:
    """Show a run until it has ended, or the viewer has; returns whether the run has ended.

    folder: of the run, which may not have begun. begin: takes its recording, which has its first
    messages, and the link to it. start_s: how long to wait for that [s].
    Raises RecordingFailed when it does not begin.
    """
    tail = _wait_for(folder, is_over, start_s)
    if tail is None:
        return False
    link = Link(folder)
    try:
        turn = begin(tail, link)
        # The first messages are there.
        is_new, grown_at = True, time.monotonic()
        while not is_over() and not tail.is_complete:
            began = time.monotonic()
            is_new = tail.poll() or is_new
            turn(is_new)
            grown_at = began if is_new else grown_at
            if link.is_lost and began - grown_at > _IDLE_S:
                # It was killed: what it has recorded is shown.
                break
            is_new = False
            time.sleep(max(0.0, FRAME_S - (time.monotonic() - began)))
        turn(tail.poll() or is_new)
        return not is_over()
    finally:
        link.close()
        tail.close()


def _wait_for(folder: Path, is_over: Callable[[], bool], start_s: float) -> Tail | None:
    """Return the recording of a run as soon as it has messages; None when the viewer has ended."""
    deadline, path, tail = time.monotonic() + start_s, folder / layout.RUN_FILE, None
    while not is_over():
        if tail is None and path.exists():
            tail = Tail(path)
        if tail is not None and tail.poll() and tail.last_step >= 0:
            return tail
        if tail is not None and tail.is_complete:
            tail.close()
            raise RecordingFailed(f"{path} has no messages, so there is nothing to show")
        if time.monotonic() > deadline:
            raise RecordingFailed(f"{folder}: no run has started there for {start_s:.0f} s")
        time.sleep(FRAME_S)
    if tail is not None:
        tail.close()
    return None
