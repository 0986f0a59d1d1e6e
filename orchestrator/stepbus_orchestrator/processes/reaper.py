"""Ends what a run leaves behind, whatever has become of its orchestrator: processes, and a folder.

The orchestrator starts it as a separate process, with nothing but the standard library. It reads
`+<process group>`, `-<process group>` and further paths from its standard input; when that closes,
however the orchestrator ended, it kills the remaining groups, and every process that a participant
has started and that is still there, names those on its standard output, and removes the paths.

A process that has left the session of its participant, and whose parent has ended, is known by its
environment: it has the participant's ticket. Nothing else of it leads back to the run: its parent
is now that of the whole machine. To become that parent (PR_SET_CHILD_SUBREAPER) does not help: the
orchestrator may be killed, may be a program of the user's with orphans of its own, and a control
group takes rights that users do not have.

The supervisor of a command that hosts participants ends its orphans with `end`.
"""

import os
import signal
import sys
import time
from collections.abc import Callable

_TICKET = "STEPBUS_TICKET"
_PATIENCE_S = 2.0
"""How long what starts others all the time may be killed again and again, and how long one in the
middle of a disk access may take to go [s]."""
_LONGEST = 100


def watch(folder: str) -> None:
    """Keep the list until the orchestrator has ended, then clean up."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    groups: set[int] = set()
    paths = [folder]
    for line in sys.stdin:
        if line[0] == "/":
            paths.append(line.rstrip("\n"))
        else:
            (groups.add if line[0] == "+" else groups.discard)(int(line[1:]))
    for group in groups:
        _try(os.killpg, group, signal.SIGKILL)
    left = end(lambda: _left(folder))
    for path in paths:
        remove(path)
    # No process reads it where the orchestrator was killed.
    _try(os.write, sys.stdout.fileno(), "\n".join(left).encode(errors="replace"))


def _try(call: Callable[..., object], *arguments: object) -> bool:
    """Return whether a call has done its work: what it is for may have ended, or be another's."""
    try:
        call(*arguments)
    except OSError:
        return False
    return True


def remove(path: str) -> None:
    """Remove a file or a folder; `shutil` takes longer to load than all else here."""
    inside = (
        f"{place}/{name}"
        for place, folders, files in os.walk(path, topdown=False)
        for name in (*folders, *files)
    )
    for one in (*inside, path):
        _try(os.rmdir, one) or _try(os.unlink, one)


def end(find: Callable[[], dict[int, str]]) -> list[str]:
    """Kill processes until none is found; return the name, process id and command of each.

    find: returns the processes that are left, by process id, each with its name in the result.
    """
    ended: dict[int, str] = {}
    give_up = time.monotonic() + _PATIENCE_S
    while (left := find()) and time.monotonic() < give_up:
        for pid, name in left.items():
            words = _content(f"/proc/{pid}/cmdline").decode(errors="replace").split("\0")
            command = " ".join(" ".join(words).split())[:_LONGEST]
            ended.setdefault(pid, f"{name} {pid} {command}")
            _try(os.kill, pid, signal.SIGKILL)
    return list(ended.values())


def _left(folder: str) -> dict[int, str]:
    """Return the processes with a ticket of this folder, and the participant of each."""
    return {
        int(pid): name.removesuffix(".ticket")
        for pid in filter(str.isdigit, os.listdir("/proc"))  # noqa: PTH208  (see below)
        for place, _, name in [ticket_of(int(pid)).rpartition("/")]
        if place == folder
    }


def ticket_of(pid: int) -> str:
    """Return the path of the ticket that a process was started with; empty: none can be read."""
    mark = f"{_TICKET}=".encode()
    variables = _content(f"/proc/{pid}/environ").split(b"\0")
    return os.fsdecode(next((v[len(mark) :] for v in variables if v.startswith(mark)), b""))


def _content(path: str) -> bytes:
    try:
        with open(path, "rb") as file:  # noqa: PTH123  (pathlib takes longer to load than all else)
            return file.read()
    except OSError:
        # Of another user, or it has ended.
        return b""


if __name__ == "__main__":
    watch(sys.argv[1])
