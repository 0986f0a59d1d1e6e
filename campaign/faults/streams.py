"""Where standard output and error of a run go."""

from __future__ import annotations

import contextlib
import os
import random

from campaign.sandbox import Sandbox


def open_stream(name: str) -> tuple[int | None, list[int]]:
    """Return the descriptor for a stream of the run, and those to close after it.

    None: a file of the sandbox.
    """
    if name == "file":
        return None, []
    if name == "full":
        descriptor = os.open("/dev/full", os.O_WRONLY)
        return descriptor, [descriptor]
    if name.endswith("terminal"):
        master, slave = os.openpty()
        if name == "full terminal":
            _fill(slave)
        return slave, [slave, master]
    read, write = os.pipe()
    if name == "closed":
        os.close(read)
        return write, [write]
    if name == "unread":
        _fill(write)
    return write, [write, read]


def _fill(write: int) -> None:
    """Leave a pipe or terminal no room for the first line of the run."""
    os.set_blocking(write, False)
    with contextlib.suppress(BlockingIOError):
        while os.write(write, bytes(4096)):
            pass
    os.set_blocking(write, True)


def close_reader(box: Sandbox, _chance: random.Random) -> None:
    """Close the other end of the pipe or terminal that the run writes to."""
    opened = box.notes["opened"]
    if len(opened) > 1:
        os.close(opened.pop())
