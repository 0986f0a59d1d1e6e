"""Who else is connected to the TCP ports of a run, as the kernel tells it: proc(5), net/tcp."""

import os
import pwd
from collections.abc import Collection, Iterator
from pathlib import Path

_LISTENS = "0A"
_NO_OWNER = ("06", "0A")
"""A connection in TIME_WAIT has no owner any more; a port that listens has no peer."""
_BACKLOG = 8
"""Connections that wait to be accepted; those of a run are accepted as they come."""


def crowd(ports: Collection[int]) -> str:
    """Return in words who keeps some ports of this machine busy; empty: nobody is seen to.

    ports: that processes of this user listen on.
    """
    rows = [row for row in _rows() if _port(row[1]) in ports or _port(row[2]) in ports]
    others = {int(row[7]) for row in rows if row[3] not in _NO_OWNER and _port(row[2]) in ports}
    names = sorted(_name(uid) for uid in others - {os.getuid()})
    if names:
        return f"{' and '.join(names)} connects to its TCP ports"
    waiting = [int(row[4].partition(":")[2], 16) for row in rows if row[3] == _LISTENS]
    count = max(waiting, default=0)
    return f"{count} connections to its TCP ports wait to be accepted" if count > _BACKLOG else ""


def _rows() -> Iterator[list[str]]:
    """Yield the fields of each IPv4 connection; none where the kernel does not tell."""
    try:
        lines = Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()[1:]
    except OSError:
        return
    for line in lines:
        yield line.split()


def _port(address: str) -> int:
    return int(address.partition(":")[2], 16)


def _name(uid: int) -> str:
    try:
        return f"user {pwd.getpwuid(uid).pw_name}"
    except KeyError:
        return f"user {uid}"
