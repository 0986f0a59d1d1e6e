"""The TCP sockets under Zenoh, which sets some of their options for other uses than ours."""

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


def tcp_links() -> Iterator[tuple[str, socket.socket]]:
    """Yield the connected TCP sockets of this process, each with `HOST:PORT` of its other end."""
    for path in filter(Path.is_socket, list(Path("/proc/self/fd").iterdir())):
        # It may have been closed meanwhile, or not be connected.
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(int(path.name))) as found:
            if found.family == socket.AF_INET:
                host, port = found.getpeername()
                yield f"{host}:{port}", found


def tune(link: socket.socket) -> None:
    """Have a link to another host carry on soon once that is back, and close at once.

    Linux waits twice as long before each repetition: after 5 s of silence, until the lease is over.
    Zenoh has `close` wait 10 s for what is not acknowledged, in vain where the other host is gone.
    """
    with contextlib.suppress(OSError):
        link.setsockopt(socket.IPPROTO_TCP, _RTO_MAX, _REPEAT_MS)
    link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)
