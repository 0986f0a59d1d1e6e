"""Looks whether this machine has what stepbus needs."""

from __future__ import annotations

import os
import shutil
import socket
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Literal

import msgspec

from stepbus import BusError, Endpoint
from stepbus.zenoh_bus import ZenohBus

Verdict = Literal["ok", "warn", "fail"]
_LINK_DEADLINE_S = 5.0
_DISK_WARN_BYTES = 1 << 30
_DISK_FAIL_BYTES = 16 << 20
_SOCKET_NAME = "stepbus-01234567/10.sock"
_EXTRAS = {
    "robots": "models of Baxter, UR5 and others for scenarios with them",
    "dev": "the tests, the type checker and the linter",
}


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that was looked at."""

    what: str
    verdict: Verdict
    text: str


def examine() -> list[Finding]:
    """Return what was found, in the order in which it should be read."""
    return [
        *_versions(),
        _cores(),
        *_disk(),
        _socket_path(),
        _ports(),
        _link("unix"),
        _link("tcp"),
        *_extras(),
    ]


def _needed(extra: str = "") -> list[str]:
    """Return the names of the packages that stepbus, or one of its extras, needs."""
    marker = f'extra == "{extra}"' if extra else "extra =="
    rows = [row.replace("'", '"') for row in requires("stepbus") or []]
    chosen = [row for row in rows if (marker in row) == bool(extra)]
    return [_name(row) for row in chosen]


def _name(requirement: str) -> str:
    stop = next((i for i, c in enumerate(requirement) if not (c.isalnum() or c in "-_.")), None)
    return requirement[:stop]


def _versions() -> Iterator[Finding]:
    python = ".".join(map(str, sys.version_info[:3]))
    good = sys.version_info >= (3, 11)
    yield Finding(what="python", verdict="ok" if good else "fail", text=python)
    for name in ("stepbus", *_needed()):
        try:
            yield Finding(what=name, verdict="ok", text=version(name))
        except PackageNotFoundError:
            text = "is not installed; run `pip install stepbus` again"
            yield Finding(what=name, verdict="fail", text=text)


def _cores() -> Finding:
    count = len(os.sched_getaffinity(0))
    text = f"{count}" if count > 1 else "1: every process waits for every other; 2 are better"
    return Finding(what="cores", verdict="ok" if count > 1 else "warn", text=text)


def _disk() -> Iterator[Finding]:
    for what, folder in (("disk, here", Path.cwd()), ("disk, temp", Path(tempfile.gettempdir()))):
        free = shutil.disk_usage(folder).free
        verdict: Verdict = "ok" if free > _DISK_WARN_BYTES else "warn"
        if free < _DISK_FAIL_BYTES:
            verdict = "fail"
        yield Finding(what=what, verdict=verdict, text=f"{free / 1e9:.1f} GB free in {folder}")


def _socket_path() -> Finding:
    path = Path(tempfile.gettempdir()) / _SOCKET_NAME
    length = len(str(path).encode())
    good = length <= 107
    text = f"{length} of at most 107 bytes" + ("" if good else "; set TMPDIR to a shorter folder")
    return Finding(what="socket path", verdict="ok" if good else "fail", text=text)


def _free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    try:
        for item in sockets:
            item.bind(("127.0.0.1", 0))
        return [item.getsockname()[1] for item in sockets]
    finally:
        for item in sockets:
            item.close()


def _ports() -> Finding:
    try:
        ports = _free_ports(8)
    except OSError as exc:
        text = f"no free TCP port on loopback: {exc.strerror}; runs over Unix sockets still work"
        return Finding(what="ports", verdict="warn", text=text)
    return Finding(what="ports", verdict="ok", text=f"free on loopback, e.g. {ports[0]}")


def _link(transport: str) -> Finding:
    """Pass a message between two sessions."""
    what = f"bus, {transport}"
    with tempfile.TemporaryDirectory(prefix="doctor-") as folder:
        if transport == "unix":
            ends = [f"unixsock-stream/{folder}/{index}.sock" for index in range(2)]
        else:
            ends = [f"tcp/127.0.0.1:{port}" for port in _free_ports(2)]
        try:
            took_s = _pass_message(ends)
        except (BusError, Empty, OSError) as exc:
            text = f"no message came through: {exc or 'silence'}; is a firewall in the way?"
            return Finding(what=what, verdict="fail", text=text)
    return Finding(
        what=what, verdict="ok", text=f"a message came through {took_s:.2f} s after start"
    )


def _pass_message(ends: list[str]) -> float:
    began = time.monotonic()
    inbox: SimpleQueue[Any] = SimpleQueue()
    first = ZenohBus(Endpoint(listen=ends[:1], connect=[]), "doctor")
    try:
        second = ZenohBus(Endpoint(listen=ends[1:], connect=ends[:1]), "doctor")
        try:
            second.subscribe("hello", inbox.put)
            put = first.publisher("hello", "text/plain")
            while time.monotonic() - began < _LINK_DEADLINE_S:
                put(b"hello")
                if not inbox.empty():
                    return time.monotonic() - began
                time.sleep(0.01)
            raise Empty
        finally:
            second.close()
    finally:
        first.close()


def _extras() -> Iterator[Finding]:
    for extra, what in _EXTRAS.items():
        missing = [name for name in _needed(extra) if not _is_installed(name)]
        text = what
        if missing:
            text = f"missing {', '.join(missing)}: {what}; pip install 'stepbus[{extra}]'"
        yield Finding(what=f"extra {extra}", verdict="warn" if missing else "ok", text=text)


def _is_installed(name: str) -> bool:
    try:
        version(name)
    except PackageNotFoundError:
        return False
    return True
