"""What a process is doing, as far as the kernel tells it: `/proc/<pid>/stat`."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_BUSY = 0.3
"""Share of a time in which a process that computes has had a processor; others want it too."""


@dataclass(frozen=True, kw_only=True)
class Activity:
    """What a process and all it has started are doing.

    is_stopped: by a signal or a debugger. waits_for_disk: one waits for a device, and takes no
    signal meanwhile. is_running: one computes, or would if it had a processor. cpu_s: processor
    time so far [s].
    """

    is_stopped: bool = False
    waits_for_disk: bool = False
    is_running: bool = False
    cpu_s: float = 0.0

    def reason(self, target: int, elapsed_s: float) -> str:
        """Return in words why the process may not get on; empty: nobody knows.

        target: process id, negative for its group, to which `kill` would send a signal.
        elapsed_s: how long it has had [s].
        """
        if self.is_stopped:
            return (
                "it has been stopped by a signal or a debugger; `kill -CONT "
                f"{target}` lets it continue."
            )
        if self.waits_for_disk:
            return (
                "it waits for a device and takes no signal meanwhile; is a disk, or a network "
                "folder, stuck?"
            )
        if self.is_running or self.cpu_s > _BUSY * elapsed_s:
            return f"it has computed for {self.cpu_s:.1f} s; what does it load, or import?"
        return ""


def activity(group: int) -> Activity:
    """Return what the processes of a group are doing; nothing where nobody knows."""
    return _activity([row for row in _rows("[0-9]*") if int(row[2]) == group])


def activity_of(pid: int) -> Activity:
    """Return what a single process is doing; nothing where nobody knows."""
    return _activity(list(_rows(str(pid))))


def _activity(rows: list[list[str]]) -> Activity:
    states = {row[0] for row in rows}
    return Activity(
        is_stopped=bool(states & {"T", "t"}),
        waits_for_disk="D" in states,
        is_running="R" in states,
        cpu_s=sum(int(row[11]) + int(row[12]) for row in rows) / _TICKS_PER_S,
    )


def _rows(pids: str) -> Iterator[list[str]]:
    """Yield the fields from the state on, see proc(5), of each process; pids: as a pattern."""
    for path in Path("/proc").glob(f"{pids}/stat"):
        if row := _row(path):
            yield row


def children(pid: int) -> set[int]:
    """Return the processes that one has started, or taken over, and not yet seen end."""
    return {
        int(path.parent.name)
        for path in Path("/proc").glob("[0-9]*/stat")
        for row in [_row(path)]
        if row and int(row[1]) == pid
    }


def descendants(pid: int) -> set[int]:
    """Return the processes that one has started, and all that these have."""
    pids = children(pid)
    return pids.union(*(descendants(child) for child in pids))


def _row(path: Path) -> list[str]:
    try:
        return path.read_bytes().rpartition(b")")[2].decode().split()
    except OSError:
        return []
