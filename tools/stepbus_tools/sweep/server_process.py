"""Starts the fork server of a sweep, where it can before the rest of the sweep is loaded."""

import contextlib
import os
import socket
import subprocess
import sys
from multiprocessing.connection import Connection

from stepbus_orchestrator.processes import PYTHON

_COMMAND = (sys.executable, "-P", "-m", "stepbus_tools.sweep.fork_server")
Server = tuple[subprocess.Popen[bytes], Connection]
"""The process, and the connection with which it ends."""
_early: list[Server] = []


def start_early() -> None:
    """Start the fork server of the next sweep: it loads on another core while the caller does."""
    with contextlib.suppress(OSError):
        _early.append(_start())


def start_server() -> Server:
    """Return a fork server; raises OSError where it cannot be started."""
    return _early.pop() if _early else _start()


def _start() -> Server:
    ours, theirs = socket.socketpair()
    channel = Connection(ours.detach())
    with theirs, contextlib.ExitStack() as stack:
        stack.callback(channel.close)
        process = subprocess.Popen(
            [*_COMMAND, str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            env={**os.environ, **PYTHON},
            start_new_session=True,
        )
        stack.pop_all()
    return process, channel
