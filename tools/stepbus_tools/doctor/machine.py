"""One finding of the doctor."""

import os
import shutil
import socket
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

import msgspec

Verdict = Literal["ok", "warn", "fail"]


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one check.

    warn: runs are slower, or something is missing that not everybody needs. fail: runs do not work.
    """

    what: str
    verdict: Verdict
    text: str


_DISK_WARN_BYTES = 1 << 30
_DISK_FAIL_BYTES = 16 << 20
# As the folder of a run and its longest socket: `stepbus-` and eight random letters.
_SOCKET_NAME = "stepbus-01234567/10.sock"
_SOCKET_PATH_BYTES = 107
_PORTS = 8


def cores() -> Finding:
    """Count the cores this process may use."""
    count = len(os.sched_getaffinity(0))
    text = f"{count}" if count > 1 else "1: the processes take turns; 2 are better"
    return Finding(what="cores", verdict="ok" if count > 1 else "warn", text=text)


def disk() -> Iterator[Finding]:
    """Check the free space for runs and sockets."""
    yield _room("disk, here", Path.cwd)
    yield _room("disk, temp", lambda: Path(tempfile.gettempdir()))


def _room(what: str, find: Callable[[], Path]) -> Finding:
    try:
        folder = find()
        free = shutil.disk_usage(folder).free
    except OSError as exc:
        text = f"cannot be used: {exc.strerror}; go to another folder, or set TMPDIR"
        return Finding(what=what, verdict="fail", text=text)
    return Finding(what=what, verdict=enough(free), text=f"{free / 1e9:.1f} GB free in {folder}")


def enough(free: int) -> Verdict:
    """Judge free space [bytes]."""
    if free < _DISK_FAIL_BYTES:
        return "fail"
    return "ok" if free >= _DISK_WARN_BYTES else "warn"


def socket_path() -> Finding:
    """Check that the path of a Unix socket is short enough."""
    try:
        path = Path(tempfile.gettempdir()) / _SOCKET_NAME
    except OSError as exc:
        text = f"no folder for temporary files: {exc.strerror}; set TMPDIR"
        return Finding(what="socket path", verdict="fail", text=text)
    length = len(str(path).encode())
    good = length <= _SOCKET_PATH_BYTES
    text = f"{length} of at most {_SOCKET_PATH_BYTES} bytes"
    if not good:
        text += "; set TMPDIR to a shorter folder, or use `--set bus.transport=tcp`"
    return Finding(what="socket path", verdict="ok" if good else "fail", text=text)


def free_ports(count: int) -> list[int]:
    """Return free TCP ports on loopback; raises OSError when there are too few."""
    sockets = [socket.socket() for _ in range(count)]
    try:
        for item in sockets:
            item.bind(("127.0.0.1", 0))
        return [item.getsockname()[1] for item in sockets]
    finally:
        for item in sockets:
            item.close()


def ports() -> Finding:
    """Check for free TCP ports."""
    try:
        free = free_ports(_PORTS)
    except OSError as exc:
        text = f"not {_PORTS} free on loopback: {exc.strerror}; runs over Unix sockets still work"
        return Finding(what="ports", verdict="warn", text=text)
    return Finding(what="ports", verdict="ok", text=f"free on loopback, e.g. {free[0]}")
