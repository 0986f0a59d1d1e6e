"""Other processes that use the TCP ports of a run."""

import os
import pwd
import sys
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

_ROOT = 0
_HERE = (f"{int.from_bytes(bytes([127, 0, 0, 1]), sys.byteorder):08X}", "00000000")
"""127.0.0.1 and any address, as the kernel writes them."""
_LISTENS = "0A"
_BACKLOG = 8
"""Connections that wait to be accepted; those of a run are accepted as they come."""


class PortUsers:
    """Other processes that were seen to use the TCP ports of a run.

    ports: that its processes listen on; none, where it uses other sockets. What comes and goes is
    seen only by frequent looks.
    """

    def __init__(self, ports: Collection[int]) -> None:
        self._ports = frozenset(ports)
        self._takers: dict[str, set[int]] = {}
        self._guests: set[str] = set()
        self._waiting = 0

    def look(self) -> str:
        """Return in words who has a port of the run now, or links of it; empty: no other user.

        Root does not count: it may do everything.
        """
        taken: dict[str, set[int]] = {}
        for row in _rows() if self._ports else ():
            name = "" if row.uid in {os.getuid(), _ROOT} else _name(row.uid)
            if row.port in self._ports and name:
                taken.setdefault(name, set()).add(row.port)
                self._takers.setdefault(name, set()).add(row.port)
            if row.peer in self._ports and row.uid != os.getuid():
                self._guests.add(_name(row.uid))
            if row.port in self._ports and row.listens:
                self._waiting = max(self._waiting, row.waiting)
        return _words(taken)

    def seen(self, left: Collection[int] = ()) -> str:
        """Return in words who was seen to keep links from opening; empty: none.

        left: ports of processes that have ended.
        """
        self.look()
        if self._takers:
            return _words(self._takers)
        held = {row.port for row in (_rows() if left else ()) if row.port in left and row.listens}
        if held:
            return _words({"another process": held})
        if self._guests:
            return f"{' and '.join(sorted(self._guests))} connects to the TCP ports of the run"
        if self._waiting > _BACKLOG:
            return f"{self._waiting} connections to a TCP port of the run wait to be accepted"
        return ""


def _words(takers: Mapping[str, Collection[int]]) -> str:
    return " and ".join(
        f"{name} uses TCP port {', '.join(map(str, sorted(ports)))} of the run"
        for name, ports in sorted(takers.items())
    )


class _Row(NamedTuple):
    """A socket. port, peer: its own on 127.0.0.1, and that of its other end; 0: elsewhere.

    waiting: connections to be accepted.
    """

    port: int
    peer: int
    listens: bool
    waiting: int
    uid: int


def _rows() -> Iterator[_Row]:
    """Yield each socket that a process has open; none where the kernel does not tell."""
    for name in ("tcp", "tcp6"):
        try:
            lines = Path(f"/proc/net/{name}").read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        for line in lines:
            _, local, remote, state, queues, _, _, uid, _, inode, *_ = line.split()
            # What no process has, such as a connection that is just closing, belongs to root.
            if inode != "0":
                waiting = int(queues.partition(":")[2], 16)
                yield _Row(_port(local), _port(remote), state == _LISTENS, waiting, int(uid))


def _port(address: str) -> int:
    host, _, port = address.partition(":")
    # An IPv4 address in one of IPv6 is at its end.
    return int(port, 16) if host[-8:] in _HERE else 0


def _name(uid: int) -> str:
    try:
        return f"user {pwd.getpwuid(uid).pw_name}"
    except KeyError:
        return f"user {uid}"
