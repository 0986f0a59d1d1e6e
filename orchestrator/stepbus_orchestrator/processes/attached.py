"""A participant that the user has started: its ticket, its process, its links to us.

The reaper removes the ticket with the run, however that ends. So a ticket that is there belongs to
a live run, and `stepbus join` waits until there is one.
"""

import contextlib
import hashlib
import os
import secrets
import shlex
import socket
import struct
import time
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.processes.activity import NOTHING, Activity, activity_of
from stepbus_orchestrator.processes.child import Child, Process
from stepbus_orchestrator.processes.reaper import ticket_of
from stepbus_participant import Ticket, open_regular
from stepbus_participant.bus.links import sockets
from stepbus_schemas import UNDECODABLE, BridgeFormat, WiringError, explained

_POLL_S = 0.1
_UNIX = "unixsock-stream/"
_CREDENTIALS = struct.Struct("3i")


class JoinTicket(Ticket, frozen=True, kw_only=True):
    """A ticket with what the scenario would have started, for `stepbus join`.

    exec, folder: the command and its working directory; empty: where it is joined. bridge,
    describe: of the bridge to it; empty: there is none. files: those of the scenario that have to
    be there, name → SHA-256.
    """

    exec: tuple[str, ...]
    folder: str
    bridge: BridgeFormat | Literal[""]
    describe: dict[str, Any]
    files: dict[str, str] = msgspec.field(default_factory=dict)


def publish(ticket: Ticket, path: Path) -> None:
    """Write a ticket to a path, whole from its first moment.

    Raises StartFailed where it cannot be written, or where the path is taken.
    """
    hidden = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        if os.path.lexists(path):
            raise FileExistsError(
                "it exists, perhaps as the ticket of another run; remove it, or choose another path"
            )
        ticket.save(hidden)
        hidden.rename(path)
    except OSError as exc:
        # Where the file system is read-only, this fails as well.
        with contextlib.suppress(OSError):
            hidden.unlink()
        raise StartFailed(
            f"{ticket.name}: its ticket {path} cannot be written: {exc.strerror or exc}",
            participant=ticket.name,
        ) from exc


def await_ticket(path: Path, wait_s: float, notify: Callable[[str], None]) -> JoinTicket:
    """Return the ticket at a path once its run is there.

    wait_s: how long to wait for it [s]. notify: is called with a sentence when it starts to wait.

    Raises WiringError when there is none in time, when what is there is none, or is of another
    user.
    """
    deadline, has_notified = time.monotonic() + wait_s, False
    while True:
        try:
            return _read(path)
        except FileNotFoundError:
            pass
        except OSError as exc:
            raise WiringError(f"{path}: {exc.strerror}") from exc
        if time.monotonic() >= deadline:
            raise WiringError(
                f"{path}: no ticket there after {wait_s:g} s; start the run with "
                "`stepbus run SCENARIO --external NAME=TICKET`, or wait longer with --wait"
            )
        if not has_notified:
            has_notified = True
            notify(f"{path}: no ticket there; waiting up to {wait_s:g} s for its run")
        time.sleep(_POLL_S)


def check_files(files: Mapping[str, str], folder: Path) -> None:
    """Raise WiringError where the files of a scenario are not those of the run. files: SHA-256."""
    for name, wanted in files.items():
        try:
            found = hashlib.sha256((folder / name).read_bytes()).hexdigest()
        except OSError as exc:
            found = exc.strerror or str(exc)
        if found != wanted:
            what = " is not that of the run" if len(found) == len(wanted) else f": {found}"
            raise WiringError(
                f"{folder / name}{what}; copy the scenario's folder from the host of the run, and "
                "join in it"
            )


def _read(path: Path) -> JoinTicket:
    """Return the ticket in a file; raises OSError, and WiringError where it is none of ours."""
    with os.fdopen(open_regular(path), "rb") as file:
        found = os.fstat(file.fileno())
        owner = found.st_uid
        if owner != os.geteuid():
            # It names a program to start.
            raise WiringError(
                f"{path}: owned by user {owner}, but you are user {os.geteuid()}; "
                f"in a container, run as that user (docker run --user {owner})"
            )
        if found.st_mode & 0o077:
            # As `ssh` does with keys: it has the participant's own one.
            mend = shlex.join(["chmod", "600", str(path)])
            raise WiringError(f"{path}: others may read it; run `{mend}`")
        try:
            return msgspec.json.decode(file.read(), type=JoinTicket)
        except UNDECODABLE as exc:
            raise WiringError(f"{path}: not a ticket: {explained(exc)}") from exc


class Attached(Process):
    """A process that the user has started, as far as we can see it.

    It is known by its place on the bus and, where it is a process of this user in our own
    namespace, by its process id. It is never sent a signal: the user who started it ends it.

    ticket: path of that it has been given. log: where a child's output would go. address: where we
    listen. children: our own processes. cut, is_silent: what cuts its links, and what `silence`
    returns, where it is linked to us by a gateway. line: the ticket, where the user gets it as one
    line; empty: at its path. is_distant: whether it is on another host, with a copy of that.
    """

    def __init__(self, ticket: Path, log: Path, address: str, children: Collection[Child]) -> None:
        super().__init__(log)
        self.ticket = ticket
        self.cut: Callable[[], None] = lambda: cut_links(
            address, self.pid, [child.pid for child in children]
        )
        self.is_silent: Callable[[], str] = str
        self.line, self.is_distant = "", False
        self._has_left = False

    @property
    def command(self) -> str:
        """Return the command that starts it; LINE stands for its ticket as a line."""
        ticket = self.ticket.name if self.is_distant else str(self.ticket)
        return shlex.join(["stepbus", "join", "LINE" if self.line else ticket])

    def joined(self, pid: int) -> None:
        """Take the process id that it gives itself, if that is a process with our ticket."""
        with contextlib.suppress(OSError):
            if self.ticket.samefile(ticket_of(pid)):
                self.pid = pid

    def left(self) -> None:
        """Record that it is no longer on the bus."""
        self._has_left = True

    def exit_code(self) -> int | None:
        """Return 0 once it has left the bus, whatever its exit code; None before."""
        return 0 if self._has_left else None

    def how_it_ended(self) -> str:
        """Return its end in words."""
        why = self.silence() or "it has ended or was killed; stepbus cannot see its exit code"
        return f"has left the bus: {why}"

    def last_output(self) -> str:
        """Return nothing: it prints where it was started."""
        return ""

    def activity(self) -> Activity:
        """Return what it is doing; nothing where that is unknown."""
        return activity_of(self.pid) if self.pid else NOTHING

    def silence(self) -> str:
        """Return that its host is out of reach, and since when; empty: it is not."""
        return self.is_silent()

    def signal(self, number: int) -> None:
        """Cut its links instead: what a signal would have freed is free then."""
        self.cut()
        self._has_left = True

    def wait(self, timeout_s: float) -> bool:
        """Return whether it has left the bus."""
        return self._has_left

    def end(self, grace_s: float = 0.0) -> None:
        """Cut its links, if it has not left the bus by itself."""
        if not self._has_left:
            self.signal(0)


# --- its links ----------------------------------------------------------------------------


def cut_links(address: str, pid: int, children: Collection[int]) -> None:
    """Cut the links that others have opened to an address of this process, under Zenoh.

    A put to a process that reads nothing blocks (P2.5). A child is killed then; a process that is
    not ours is left alone, and only its link to us ends.

    address: where it listens. pid: of the one whose links are cut; 0: unknown, then of all that
    are no children, as far as the kernel tells. children: their process ids; each leads a session.
    """
    for link in sockets():
        # It may have been closed meanwhile, or not be connected.
        with contextlib.suppress(OSError):
            if _is_accepted(link, address) and not _is_of_another(link, pid, children):
                link.shutdown(socket.SHUT_RDWR)


def _is_accepted(link: socket.socket, address: str) -> bool:
    """Return whether a socket is connected at our address, as Zenoh writes that."""
    own, _ = link.getsockname(), link.getpeername()
    if link.family == socket.AF_UNIX:
        return address == f"{_UNIX}{own}"
    return link.family == socket.AF_INET and address == f"tls/{own[0]}:{own[1]}"


def _is_of_another(link: socket.socket, pid: int, children: Collection[int]) -> bool:
    """Return whether another process than that of `cut_links` has opened a link."""
    if link.family != socket.AF_UNIX:
        return False
    credentials = link.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    peer, _, _ = _CREDENTIALS.unpack(credentials)
    if not peer:
        # Of another namespace.
        return False
    with contextlib.suppress(ProcessLookupError):
        return peer != pid if pid else os.getsid(peer) in children
    return False
