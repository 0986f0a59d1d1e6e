"""Starts the fork server of a sweep, if possible while the rest of the sweep is loaded."""

import os
import socket
import subprocess
import sys
from multiprocessing.connection import Connection

from stepbus_orchestrator.processes import PYTHON

_COMMAND = (sys.executable, "-P", "-m", "stepbus_tools.sweep.fork_server")
early: list[tuple[subprocess.Popen[bytes], Connection]] = []
"""Those that wait for a sweep."""


def start_server() -> tuple[subprocess.Popen[bytes], Connection]:
    """Return a new fork server, and the connection with which it ends; raises OSError."""
    ours, theirs = socket.socketpair()
    with theirs, ours:
        process = subprocess.Popen(
            [*_COMMAND, str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            env={**os.environ, **PYTHON},
            start_new_session=True,
        )
        return process, Connection(ours.detach())


def end_early() -> None:
    """End what no sweep has taken."""
    while early:
        process, channel = early.pop()
        channel.close()
        process.kill()
        process.wait()  # no time-out: it was killed
