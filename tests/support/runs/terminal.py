"""A command as a user at a terminal starts it."""

import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios

STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]


def at_terminal(words, *, columns=80, cwd=None, **variables):
    """Run `stepbus` at a terminal of its own; return its exit code and all that it has shown."""
    mine, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    unset = {"COLUMNS", "NO_COLOR", "FORCE_COLOR"}
    rest = {name: value for name, value in os.environ.items() if name not in unset}
    process = subprocess.Popen(
        [*STEPBUS, *words],
        stdin=its,
        stdout=its,
        stderr=its,
        cwd=cwd,
        env={**rest, "TERM": "xterm-256color", **variables},
        start_new_session=True,
    )
    os.close(its)
    shown = b""
    try:
        # It ends with the last process that holds the terminal, as an error.
        while piece := _read(mine):
            shown += piece
        return process.wait(30), shown.decode().replace("\r\n", "\n")
    finally:
        process.kill()
        process.wait()
        os.close(mine)


def _read(terminal):
    try:
        return os.read(terminal, 1 << 16)
    except OSError:
        return b""
