"""Tickets that somebody else picks up: a file that shows whether its run still lasts.

The orchestrator holds a lock (flock) on the file while it lives, however it ends. So whoever finds
a ticket knows whether it is of a run that has ended, and a stale one is waited out.
"""

import contextlib
import fcntl
import os
import secrets
import stat
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import msgspec

from stepbus_orchestrator.errors import StartFailed
from stepbus_participant import Ticket
from stepbus_schemas import UNDECODABLE, BridgeFormat, WiringError, explained

_POLL_S = 0.1
_MOST_BYTES = 1 << 20


class JoinTicket(Ticket, frozen=True, kw_only=True):
    """A ticket with what the scenario would have started, for `stepbus join`.

    exec, folder: the command and its working directory. bridge, describe: of the bridge to it;
    empty: there is none.
    """

    exec: list[str]
    folder: str
    bridge: BridgeFormat | Literal[""]
    describe: dict[str, Any]


class SharedTicket:
    """A ticket at a path that others know, for as long as its run lasts.

    path: absolute. Raises StartFailed where it cannot be written, where it would replace something
    else than the ticket of a run that has ended.
    """

    def __init__(self, ticket: JoinTicket, path: Path) -> None:
        self.path = path.absolute()
        _check_replaceable(self.path, ticket.name)
        try:
            self._file = _publish(msgspec.json.encode(ticket), self.path)
        except OSError as exc:
            raise StartFailed(
                f"{ticket.name}: its ticket {path} cannot be written: {exc.strerror}",
                participant=ticket.name,
            ) from exc

    def is_named_by(self, value: str) -> bool:
        """Return whether a path, as a process knows it, leads to this file."""
        try:
            return os.path.samestat(Path(value).stat(), os.fstat(self._file))
        except (OSError, ValueError):
            return False

    def close(self) -> None:
        """Remove the file, unless somebody has put something else there."""
        with contextlib.suppress(OSError):
            if self.is_named_by(str(self.path)):
                self.path.unlink()
        os.close(self._file)


def _publish(content: bytes, path: Path) -> int:
    """Write a file with a lock on it, then give it its name; return its descriptor."""
    hidden = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    file = os.open(hidden, flags, 0o600)
    try:
        os.write(file, content)
        # Some file systems have no locks; there, any ticket counts as one of a run that lasts.
        with contextlib.suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        hidden.rename(path)
    except BaseException:
        os.close(file)
        hidden.unlink(missing_ok=True)
        raise
    return file


def _check_replaceable(path: Path, name: str) -> None:
    """Raise StartFailed where a path holds anything but the ticket of a run that has ended."""
    try:
        _, lasts = _read(path)
    except FileNotFoundError:
        return
    except (OSError, WiringError) as exc:
        raise StartFailed(
            f"{name}: its ticket would replace {path}, which is no ticket ({exc}); choose another "
            "path",
            participant=name,
        ) from exc
    if lasts:
        raise StartFailed(
            f"{name}: {path} is the ticket of another run, which still lasts; choose another path",
            participant=name,
        )


def await_ticket(path: Path, wait_s: float, notify: Callable[[str], None]) -> JoinTicket:
    """Return the ticket at a path once its run is there.

    wait_s: how long to wait for it [s]. notify: is called with a sentence when it starts to wait,
    and when the reason changes.

    Raises WiringError when there is none in time, when what is there is none, or is of another
    user.
    """
    deadline, known = time.monotonic() + wait_s, ""
    while True:
        reason = "no ticket there"
        with contextlib.suppress(FileNotFoundError):
            ticket, lasts = _checked(path)
            if lasts:
                return ticket
            reason = "the ticket there is of a run that has ended"
        if time.monotonic() >= deadline:
            raise WiringError(
                f"{path}: {reason}, after {wait_s:g} s; start the run with "
                "`stepbus run SCENARIO --external NAME=TICKET`, or wait longer with --wait"
            )
        if reason != known:
            known = reason
            notify(f"{path}: {reason}; waiting up to {wait_s:g} s for its run")
        time.sleep(_POLL_S)


def _checked(path: Path) -> tuple[JoinTicket, bool]:
    try:
        return _read(path)
    except FileNotFoundError:
        raise
    except OSError as exc:
        raise WiringError(f"{path}: {exc.strerror}") from exc


def _read(path: Path) -> tuple[JoinTicket, bool]:
    """Return a ticket, and whether its run lasts; raises OSError, WiringError."""
    # A pipe of that name must not keep us waiting.
    file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(file)
        if not stat.S_ISREG(status.st_mode):
            raise WiringError(f"{path}: a ticket is a file")
        if status.st_uid != os.geteuid():
            raise WiringError(
                f"{path}: it belongs to user {status.st_uid}, and you are {os.geteuid()}; in a "
                f"container, become that user (docker run --user {status.st_uid})"
            )
        content = os.read(file, _MOST_BYTES)
        try:
            return msgspec.json.decode(content, type=JoinTicket), _lasts(file)
        except UNDECODABLE as exc:
            raise WiringError(f"{path}: not a ticket: it {explained(exc)}") from exc
    finally:
        os.close(file)


def _lasts(file: int) -> bool:
    """Return whether somebody holds the lock; True where nobody can tell."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    return False
