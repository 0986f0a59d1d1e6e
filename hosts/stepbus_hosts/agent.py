"""Starts and ends the processes of one run on this host, for an orchestrator on another one.

The orchestrator starts it by SSH, and speaks with it over its standard input and output. When
these close, or nothing has come for the lease, it ends all that it has started; should it be killed
itself, its reaper does.
"""

import contextlib
import hashlib
import os
import re
import select
import signal
import socket
import sys
import tempfile
import time
from pathlib import Path
from typing import BinaryIO

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.processes.launcher import Launcher
from stepbus_orchestrator.replay.sources import Sources
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_orchestrator.scenario.program import command
from stepbus_participant import make_folder, write_file
from stepbus_schemas import StepbusError

from . import wire
from .versions import host_versions

SCENARIO = "scenario"
"""The key of the scenario itself among its files."""
_LOOK_S = 0.02
_TURN_BYTES = 1 << 18
"""What of a log is sent between two looks at what the orchestrator asks for."""
_LATE_BYTES = 1 << 24
_PIECE_BYTES = _TAIL_BYTES = 1 << 16
"""A log that is so late when its participant has ended is sent without its middle."""
_KEPT_S = 30 * 86400
_DIGEST = re.compile("[0-9a-f]{64}")
_REACH_S = 5.0


class _Lost(Exception):
    """The orchestrator is out of reach, or has ended."""


class _Agent:
    def __init__(self) -> None:
        self._frames = wire.Frames(0)
        self._lease_s, self._beat_s = 60.0, 1.0
        self._heard = self._sent = time.monotonic()
        self._launcher: Launcher | None = None
        self._order: wire.Open | None = None
        self._cache = Path()
        self._home = Path()
        self._logs: dict[str, BinaryIO] = {}
        self._ended: set[str] = set()
        self._is_behind = False

    def work(self) -> None:
        """Do what the orchestrator asks for, until it is gone."""
        os.write(1, wire.MARK)
        try:
            while True:
                self._turn()
        except (_Lost, EOFError):
            return
        except (StepbusError, OSError) as exc:
            with contextlib.suppress(OSError):
                self._send(wire.Problem(sentence(exc, self._cache)))
        finally:
            # All at once, before each in its turn.
            for child in self._children.values():
                child.terminate()
            left = [] if self._launcher is None else self._launcher.end_all()
            with contextlib.suppress(OSError):
                self._report(is_last=True)
                self._send(wire.Left(left))

    def _turn(self) -> None:
        ready, _, _ = select.select([0], [], [], 0 if self._is_behind else _LOOK_S)
        now = time.monotonic()
        if ready:
            self._heard = now
            for frame in self._frames.read():
                self._take(frame)
        elif now - self._heard > self._lease_s:
            raise _Lost
        self._report()
        if now - self._sent > self._beat_s:
            self._send(wire.Beat())

    def _send(self, frame: wire.Frame) -> None:
        """Send a frame; where nobody takes it for the lease, we are killed, and the reaper acts."""
        self._sent = time.monotonic()
        signal.setitimer(signal.ITIMER_REAL, self._lease_s)
        data = memoryview(wire.packed(frame))
        while data:
            data = data[os.write(1, data) :]
        signal.setitimer(signal.ITIMER_REAL, 0)

    def _take(self, frame: wire.Frame) -> None:
        match frame:
            case wire.Open():
                self._open(frame)
            case wire.Content(files=files):
                for content in files.values():
                    name = hashlib.sha256(content).hexdigest()
                    write_file(self._cache / name, content, 0o600)
                self._unpack()
            case wire.Start():
                self._start(frame)
            case wire.Signal(name=name, number=number):
                if (child := self._children.get(name)) is not None:
                    child.signal(number)
            case wire.Probe():
                self._send(_probed(frame))
            case wire.Close():
                raise _Lost

    def _open(self, order: wire.Open) -> None:
        self._order, self._lease_s = order, order.lease_s
        self._beat_s = min(0.5, order.lease_s / 4)
        self._cache = Path(order.folder).expanduser() / "files"
        make_folder(self._cache)
        with tempfile.TemporaryFile(dir=self._cache):
            pass  # That one can be written shows in time.
        for path in self._cache.iterdir():
            # Whatever else the user has there is not ours.
            if _DIGEST.fullmatch(path.name) and path.is_file():
                with contextlib.suppress(FileNotFoundError):
                    if path.stat().st_mtime < time.time() - _KEPT_S:
                        path.unlink()
        self._launcher = Launcher(run=order.run, token=order.token)
        missing = [name for name in set(order.files.values()) if not self._has(name)]
        origin = os.environ.get("SSH_CONNECTION", "").partition(" ")[0]
        self._send(wire.Greeting(host_versions(), origin, missing))
        if order.files and not missing:
            self._unpack()

    def _has(self, name: str) -> bool:
        """Return whether a file is in the cache, whole and unchanged."""
        if not (self._cache / name).is_file():
            return False
        try:
            content = (self._cache / name).read_bytes()
            os.utime(self._cache / name)
        except OSError:
            return False
        return hashlib.sha256(content).hexdigest() == name

    def _unpack(self) -> None:
        assert self._order is not None  # noqa: S101
        assert self._launcher is not None  # noqa: S101
        files = {k: (self._cache / v).read_bytes() for k, v in self._order.files.items()}
        sources = Sources(files.pop(SCENARIO), files)
        self._home = sources.unpack(self._launcher.folder / "source").parent

    @property
    def _children(self) -> dict[str, Child]:
        return {} if self._launcher is None else self._launcher.children

    def _start(self, order: wire.Start) -> None:
        assert self._launcher is not None  # noqa: S101
        spec = ParticipantSpec(
            name=order.name, exec=order.program, join_timeout_ns=order.join_timeout_ns
        )
        try:
            argv = command(order.program, self._home)
            child = self._launcher.start(spec, argv, order.endpoint, self._home, **order.fields)
        except (StartFailed, StepbusError) as exc:
            self._send(wire.Started(order.name, problem=str(exc)))
            return
        self._logs[order.name] = child.log.open("rb")
        self._send(wire.Started(order.name, child.pid))

    def _report(self, *, is_last: bool = False) -> None:
        """Send what participants have printed, and which have ended.

        is_last: all have ended.
        """
        self._is_behind = False
        for name, child in self._children.items():
            code = None if name in self._ended else child.exit_code()
            is_whole, log = is_last or code is not None, self._logs[name]
            # What it has started may print on without end.
            behind = os.fstat(log.fileno()).st_size - log.tell()
            if is_whole and behind > _LATE_BYTES:
                skipped, behind = behind - _TAIL_BYTES, _TAIL_BYTES
                log.seek(skipped, os.SEEK_CUR)
                self._send(wire.Printed(name, b"\n[%d bytes are left out]\n" % skipped))
            left = behind if is_whole else min(behind, _TURN_BYTES)
            while left and (text := log.read(min(left, _PIECE_BYTES))):
                left -= len(text)
                self._send(wire.Printed(name, text))
            self._is_behind |= behind > _TURN_BYTES
            if code is not None:
                self._ended.add(name)
                self._send(wire.Ended(name, code))


def sentence(exc: Exception, folder: Path) -> str:
    """Return what is wrong, with the file if it is one; folder: where we write."""
    if isinstance(exc, StepbusError):
        # What it names is a folder of ours.
        return str(exc).removesuffix("; choose another --out")
    if isinstance(exc, OSError):
        return f"{exc.filename or folder}: {exc.strerror}; may you write there, is there room?"
    return str(exc)


def _probed(order: wire.Probe) -> wire.Probed:
    """Send the proof to the port, if there is one."""
    began_s, took_s, problem = time.monotonic(), 0.0, ""
    try:
        if order.port:
            with socket.create_connection((order.host, order.port), _REACH_S) as link:
                took_s = time.monotonic() - began_s
                link.sendall(order.proof)
    except OSError as exc:
        problem = exc.strerror or f"no answer within {_REACH_S:g} s"
    return wire.Probed(time.time(), took_s, problem)


def main() -> None:
    """Work for the orchestrator at the other end of standard input and output."""
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, lambda *_: sys.exit(1))
    _Agent().work()


if __name__ == "__main__":
    main()
