"""Cuts links of this process to others, by closing their sockets under Zenoh.

A put to a process that reads nothing blocks (P2.5). A child is killed then; a process that is not
ours is left alone, and only its link to us ends.
"""

import os
import socket
import struct
from collections.abc import Collection, Iterator
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
