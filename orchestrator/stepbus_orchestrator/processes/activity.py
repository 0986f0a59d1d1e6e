"""What a process is doing, as far as the kernel tells it: `/proc/<pid>/stat`."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_BUSY = 0.3
"""Share of a time in which a process that computes has had a processor; others want it too."""
_STATE, _PARENT, _GROUP, _USER_TICKS, _SYSTEM_TICKS = 0, 1, 2, 11, 12
"""Fields after the name of the program, see proc(5)."""


@dataclass(frozen=True, kw_only=True)
class Activity:
    """What a process and all it has started are doing.

    is_stopped: by a signal or a debugger. is_running: one computes, or would if it had a processor.
    cpu_s: processor time so far [s].
    """

    is_stopped: bool = False
    is_running: bool = False
    cpu_s: float = 0.0

    def reason(self, target: int, elapsed_s: float) -> str:
        """Return in words why the process may not get on; empty: unknown.

        target: process id, negative for its group, to which `kill` would send a signal.
        elapsed_s: how long it has had [s].
        """
        if self.is_stopped:
            return f"a signal or a debugger has stopped it; `kill -CONT {target}` resumes it."
        if self.is_running or self.cpu_s > _BUSY * elapsed_s:
            return f"it has computed for {self.cpu_s:.1f} s; what does it load or import?"
        return ""


def activity(group: int) -> Activity:
    """Return what the processes of a group are doing; nothing where that is unknown."""
    return _activity(row for _, row in _rows() if int(row[_GROUP]) == group)


def activity_of(pid: int) -> Activity:
    """Return what a single process is doing; nothing where that is unknown."""
    return _activity(row for _, row in _rows(str(pid)))


NOTHING = Activity()


def _activity(rows: Iterator[list[str]]) -> Activity:
    own = list(rows)
    states = {row[_STATE] for row in own}
    ticks = sum(int(row[_USER_TICKS]) + int(row[_SYSTEM_TICKS]) for row in own)
    return Activity(
        is_stopped=bool(states & {"T", "t"}),
        is_running="R" in states,
        cpu_s=ticks / _TICKS_PER_S,
    )


def children(pid: int) -> set[int]:
    """Return the processes that one has started, or taken over, and not yet seen end."""
    return {child for child, row in _rows() if int(row[_PARENT]) == pid}


def _rows(pids: str = "[0-9]*") -> Iterator[tuple[int, list[str]]]:
    """Yield each process, with its fields after the name; pids: as a pattern."""
    for path in Path("/proc").glob(f"{pids}/stat"):
        try:
            yield int(path.parent.name), path.read_bytes().rpartition(b")")[2].decode().split()
        except OSError:
            # It has ended.
            continue
