"""The sockets under Zenoh, which sets some of their options for other uses than ours."""

import contextlib
import os
import socket
import struct
from collections.abc import Iterator
from pathlib import Path

_NO_LINGER = struct.pack("ii", 0, 0)
"""`struct linger`, off: `close` returns at once, and the kernel goes on to send what is left."""
_RTO_MAX = 44
"""`TCP_RTO_MAX_MS`, since Linux 6.15."""
_REPEAT_MS = 1000


def sockets() -> Iterator[socket.socket]:
    """Yield the sockets of this process, each of them open until the next one."""
    for path in filter(Path.is_socket, list(Path("/proc/self/fd").iterdir())):
        # It may have been closed meanwhile.
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(int(path.name))) as found:
            yield found


def tcp_links() -> Iterator[tuple[str, socket.socket]]:
    """Yield the connected TCP sockets of this process, each with `HOST:PORT` of its other end."""
    for link in sockets():
        # Others are not connected.
        with contextlib.suppress(OSError):
            if link.family == socket.AF_INET:
                host, port = link.getpeername()
                yield f"{host}:{port}", link


def tune(link: socket.socket) -> None:
    """Have a link to another host carry on soon once that is back, and close at once.

    Linux waits twice as long before each repetition: after 5 s of silence, until the lease is over.
    Zenoh has `close` wait 10 s for what is not acknowledged, in vain where the other host is gone.
    """
    with contextlib.suppress(OSError):
        link.setsockopt(socket.IPPROTO_TCP, _RTO_MAX, _REPEAT_MS)
    link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)
