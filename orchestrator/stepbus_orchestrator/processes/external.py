"""A participant that the user has started: its ticket, its process, its links to us.

The orchestrator holds a lock (flock) on the ticket while it lives, however it ends. So a
ticket shows whether its run has ended, and `stepbus join` waits until a stale one is replaced.
"""

import contextlib
import fcntl
import os
import secrets
import socket
import stat
import struct
import time
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, Literal

import msgspec

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.processes.activity import NOTHING, Activity, activity_of
from stepbus_orchestrator.processes.child import Child, Process
from stepbus_participant import TICKET_VARIABLE, Ticket
from stepbus_schemas import UNDECODABLE, BridgeFormat, WiringError, explained

_POLL_S = 0.1
_MOST_BYTES = 1 << 20
_UNIX = "unixsock-stream/"
_CREDENTIALS = struct.Struct("3i")


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
        """Remove the file, unless another process has put something else there."""
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
            f"{name}: {path} exists and is not a ticket ({exc}); choose another path",
            participant=name,
        ) from exc
    if lasts:
        raise StartFailed(
            f"{name}: {path} is the ticket of another live run; choose another path",
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
        try:
            ticket, lasts = _read(path)
            if lasts:
                return ticket
            reason = "the ticket there is of a run that has ended"
        except FileNotFoundError:
            reason = "no ticket there"
        except OSError as exc:
            raise WiringError(f"{path}: {exc.strerror}") from exc
        if time.monotonic() >= deadline:
            raise WiringError(
                f"{path}: {reason}, after {wait_s:g} s; start the run with "
                "`stepbus run SCENARIO --external NAME=TICKET`, or wait longer with --wait"
            )
        if reason != known:
            known = reason
            notify(f"{path}: {reason}; waiting up to {wait_s:g} s for its run")
        time.sleep(_POLL_S)


def _read(path: Path) -> tuple[JoinTicket, bool]:
    """Return a ticket, and whether its run lasts; raises OSError, WiringError."""
    # A pipe of that name must not keep us waiting.
    file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(file)
        if not stat.S_ISREG(status.st_mode):
            raise WiringError(f"{path}: not a file; give the path of a ticket")
        if status.st_uid != os.geteuid():
            raise WiringError(
                f"{path}: owned by user {status.st_uid}, but you are user {os.geteuid()}; "
                f"in a container, run as that user (docker run --user {status.st_uid})"
            )
        content = os.read(file, _MOST_BYTES)
        try:
            return msgspec.json.decode(content, type=JoinTicket), _lasts(file)
        except UNDECODABLE as exc:
            raise WiringError(f"{path}: not a ticket: it {explained(exc)}") from exc
    finally:
        os.close(file)


def _lasts(file: int) -> bool:
    """Return whether a process holds the lock; True where that cannot be told."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    return False


class External(Process):
    """A process that the user has started, as far as we can see it.

    It is known by its place on the bus and, where it is a process of this user in our own
    namespace, by its process id. It is never sent a signal: the user who started it ends it.

    ticket: that it has been given. log: where a child's output would go. address: where we listen.
    children: our own processes.
    """

    def __init__(
        self, ticket: SharedTicket, log: Path, address: str, children: Collection[Child]
    ) -> None:
        super().__init__(log)
        self.ticket = ticket
        self._address = address
        self._children = children
        self._has_left = False

    def joined(self, pid: int) -> None:
        """Take the process id that it gives itself, if that is a process with our ticket."""
        prefix = f"{TICKET_VARIABLE}=".encode()
        with contextlib.suppress(OSError):
            variables = Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
            own = [os.fsdecode(v[len(prefix) :]) for v in variables if v.startswith(prefix)]
            if any(self.ticket.is_named_by(value) for value in own):
                self.pid = pid

    def left(self) -> None:
        """Record that it is no longer on the bus."""
        self._has_left = True

    def exit_code(self) -> int | None:
        """Return 0 once it has left the bus, whatever its exit code; None before."""
        return 0 if self._has_left else None

    def how_it_ended(self) -> str:
        """Return its end in words."""
        return "has left the bus: it has ended or was killed; stepbus cannot see its exit code"

    def last_output(self) -> str:
        """Return nothing: it prints where it was started."""
        return ""

    def log_problem(self) -> str:
        """Return nothing: it has no log here."""
        return ""

    def activity(self) -> Activity:
        """Return what it is doing; nothing where that is unknown."""
        return activity_of(self.pid) if self.pid else NOTHING

    def signal(self, number: int) -> None:
        """Cut its links instead: what a signal would have freed is free then."""
        cut_links(self._address, self.pid, [child.pid for child in self._children])
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
    for link in _accepted(address):
        with link:
            peer = _peer(link)
            is_another = bool(peer) and (peer != pid if pid else _session(peer) in children)
            if not is_another:
                link.shutdown(socket.SHUT_RDWR)


def _accepted(address: str) -> Iterator[socket.socket]:
    """Yield a copy of each connected socket that was accepted at an address."""
    for path in list(Path("/proc/self/fd").iterdir()):
        try:
            if not path.is_socket():
                continue
            copy = socket.socket(fileno=os.dup(int(path.name)))
        except OSError:
            continue
        if _is_accepted(copy, address):
            yield copy
        else:
            copy.close()


def _is_accepted(link: socket.socket, address: str) -> bool:
    """Return whether a socket is connected at our address, as Zenoh writes that."""
    try:
        own = link.getsockname()
        link.getpeername()
    except OSError:
        return False
    if link.family == socket.AF_UNIX:
        return address == f"{_UNIX}{own}"
    return link.family == socket.AF_INET and address == f"tls/{own[0]}:{own[1]}"


def _peer(link: socket.socket) -> int:
    """Return the process id of a link's opener; 0: the kernel does not tell."""
    if link.family != socket.AF_UNIX:
        return 0
    size = _CREDENTIALS.size
    pid: int = _CREDENTIALS.unpack(link.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))[0]
    return pid


def _session(pid: int) -> int:
    try:
        return os.getsid(pid)
    except OSError:
        return 0
