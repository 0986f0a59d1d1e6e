"""Cuts links of this process to others, by closing their sockets under Zenoh.

A put to a process that reads nothing blocks (P2.5). A child is killed then; a process that is not
ours is left alone, and only its link to us ends.
"""

import os
import pwd
import socket
import struct
import sys
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

_UNIX = "unixsock-stream/"
_CREDENTIALS = struct.Struct("3i")


def cut_links(address: str, pid: int, children: Collection[int]) -> None:
    """Cut the links that others have opened to an address of this process.

    address: where it listens. pid: of the one whose links are cut; 0: unknown, then of all that
    are no children, as far as the kernel tells. children: their process ids; each leads a session.
    """
    for link in _accepted(address):
        with link:
            peer = _peer(link)
            if pid and peer and peer != pid:
                continue
            if peer and not pid and _session(peer) in children:
                continue
            link.shutdown(socket.SHUT_RDWR)


def _accepted(address: str) -> Iterator[socket.socket]:
    """Yield a copy of each connected socket that was accepted at an address."""
    for path in list(Path("/proc/self/fd").iterdir()):
        try:
            if not path.is_socket():
                continue
            copy = socket.socket(fileno=os.dup(int(path.name)))
        except OSError:
            continue
        if _is_accepted(copy, address):
            yield copy
        else:
            copy.close()


def _is_accepted(link: socket.socket, address: str) -> bool:
    """Return whether a socket is connected at our address, as Zenoh writes that."""
    try:
        own = link.getsockname()
        link.getpeername()
    except OSError:
        return False
    if link.family == socket.AF_UNIX:
        return address == f"{_UNIX}{own}"
    return link.family == socket.AF_INET and address == f"tls/{own[0]}:{own[1]}"


def _peer(link: socket.socket) -> int:
    """Return the process id of who has opened a link; 0: the kernel does not tell."""
    if link.family != socket.AF_UNIX:
        return 0
    size = _CREDENTIALS.size
    pid: int = _CREDENTIALS.unpack(link.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))[0]
    return pid


def _session(pid: int) -> int:
    try:
        return os.getsid(pid)
    except OSError:
        return 0


_ROOT = 0
_HERE = (f"{int.from_bytes(bytes([127, 0, 0, 1]), sys.byteorder):08X}", "00000000")
"""127.0.0.1 and any address, as the kernel writes them."""
_LISTENS = "0A"
_BACKLOG = 8
"""Connections that wait to be accepted; those of a run are accepted as they come."""


class PortUsers:
    """Who else was seen to use the TCP ports of a run.

    ports: that its processes listen on; none, where it uses other sockets. What comes and goes is
    seen where somebody looks often.
    """

    def __init__(self, ports: Collection[int]) -> None:
        self._ports = frozenset(ports)
        self._takers: dict[str, set[int]] = {}
        self._guests: set[str] = set()
        self._waiting = 0

    def look(self) -> str:
        """Return in words who has a port of the run now, or links of it; empty: nobody else.

        Root is nobody else: it may do everything.
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
        """Return in words who was seen to keep links from opening; empty: nobody.

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
        f"{name} has taken TCP port {', '.join(map(str, sorted(ports)))} of the run"
        for name, ports in sorted(takers.items())
    )


@dataclass(frozen=True)
class _Row:
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
