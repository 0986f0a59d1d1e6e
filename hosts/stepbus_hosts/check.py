"""`stepbus doctor --hosts`: whether this host and others reach each other, before a run."""

import contextlib
import secrets
import socket
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Literal

from stepbus_orchestrator.errors import Interrupted, StartFailed
from stepbus_schemas import WiringError

from . import wire
from .addresses import open_port, parse_address
from .connection import Connection, ssh_command
from .hosts_file import HostSpec, read_hosts
from .versions import MUST_AGREE, compared, host_versions

Row = tuple[str, Literal["ok", "warn", "fail"], str]
"""What was checked, how that went, in words."""

_LEASE_S = 10.0
_SSH_S = 30.0
_PROOF_S = 2.0
_ROUNDS = 5
_SSH_HINTS = {
    "Permission denied": "let your key in there (`ssh-copy-id`), or load it (`ssh-add`)",
    "Could not resolve": "is its `address` right?",
    "Host key verification": "connect to it once by hand, and compare its key",
}


def check_hosts(file: Path, listen: str) -> Iterator[Row]:
    """Check all hosts of a file both ways. listen: `ADDRESS[:PORT]` of the run; empty: as there.

    Raises SettingsError, and WiringError for what is no address.
    """
    hosts = read_hosts(file)
    if not hosts:
        yield "hosts", "fail", f"{file} has none"
    address, port = parse_address(listen) if listen else ("", 0)
    interrupt = threading.Event()
    checked = [Host(name, spec, interrupt) for name, spec in hosts.items()]
    with ExitStack() as stack:
        # All close at once, also where Ctrl-C comes while all are being reached.
        pool = stack.enter_context(ThreadPoolExecutor(max_workers=1 + 2 * len(hosts)))
        for host in checked:
            stack.callback(pool.submit, host.close)
        stack.callback(interrupt.set)
        for rows in pool.map(Host.reach, checked):
            yield from rows
        reached = [host for host in checked if host.versions]
        if reached:
            origin = next(filter(None, (host.origin for host in reached)), "")
            yield from _back(reached, address or origin, port)
            table = {host.name: host.versions for host in reached}
            yield from _versions({"here": host_versions(), **table})


class Host:
    """A host, and the agent there.

    interrupt: ends the wait for it. origin, versions: what that has said of itself; empty: it is
    not reached.
    """

    def __init__(self, name: str, spec: HostSpec, interrupt: threading.Event) -> None:
        self.name, self.spec, self._interrupt = name, spec, interrupt
        self.origin, self.versions = "", dict[str, str]()
        self._connection: Connection | None = None

    def close(self) -> None:
        """Leave nothing there."""
        if self._connection is not None:
            self._connection.close()

    def reach(self) -> list[Row]:
        """Reach it by SSH, and start the agent there."""
        spec, began_s = self.spec, time.monotonic()
        what = f"here → {self.name}"
        try:
            done = subprocess.run(
                ssh_command(spec, "exit 0"),
                check=False, capture_output=True, text=True, stdin=subprocess.DEVNULL,
                timeout=_SSH_S, errors="replace",
            )  # fmt: skip
        except OSError as exc:
            return [(what, "fail", f"ssh cannot be started: {exc.strerror}; install OpenSSH")]
        except subprocess.TimeoutExpired:
            return [(what, "fail", f"`ssh {spec.destination}` has not ended after {_SSH_S:g} s")]
        if done.returncode:
            said = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
            closed = f"is sshd up there? Open its port (TCP 22 by default) inbound on {self.name}"
            hint = next((hint for words, hint in _SSH_HINTS.items() if words in said), closed)
            return [(what, "fail", f"`ssh {spec.destination}` fails: {said.strip()}; {hint}")]
        took_s = time.monotonic() - began_s
        row: Row = (what, "ok", f"`ssh {spec.destination}` takes {took_s:.2f} s")
        return [row, self._greet()]

    def _greet(self) -> Row:
        what, spec = f"{self.name}, agent", self.spec
        order = wire.Open("doctor", secrets.token_hex(8), _LEASE_S, spec.folder, {})
        try:
            self._connection = Connection(self.name, spec, order, self._interrupt)
            greeting = self._connection.greeting()
        except (StartFailed, Interrupted) as exc:
            hint = "; install stepbus there, or name the right `python`"
            return what, "fail", f"{exc}{hint * ('not installed' in str(exc))}"
        self.origin, self.versions = greeting.origin, greeting.versions
        return what, "ok", f"{spec.python} has stepbus, and can write to {spec.folder}"

    def probe(self, order: wire.Probe) -> wire.Probed:
        """Have the agent look at a port."""
        assert self._connection is not None  # noqa: S101
        return self._connection.probe(order)


def _back(hosts: list[Host], address: str, port: int) -> Iterator[Row]:
    """Open the port, as a run would, and have all hosts connect to it."""
    if not address:
        yield "listen", "fail", "no host says how it was reached; give --listen ADDRESS"
        return
    try:
        listener = open_port(address, port)
    except WiringError as exc:
        yield "listen", "fail", str(exc)
        return
    with listener:
        for host in hosts:
            try:
                yield _reached(host, listener, address, port)
                yield _times(host)
            except StartFailed as exc:
                yield f"{host.name} → here", "fail", str(exc)


def _reached(host: Host, listener: socket.socket, address: str, port: int) -> Row:
    """Have a host connect to us. port: that the user has chosen; 0: none."""
    seen, forwarded = parse_address(host.spec.reaches) if host.spec.reaches else (address, 0)
    number = forwarded or listener.getsockname()[1]
    what, where = f"{host.name} → here", f"{seen}:{number}"
    proof = secrets.token_bytes(16)
    probed = host.probe(wire.Probe(seen, number, proof))
    if probed.problem:
        mend = advice(host, address, port)
        return what, "fail", f"it does not reach {where}: {probed.problem}; {mend}"
    if not _comes(listener, proof):
        mend = "--listen the address by which it reaches this host, or say `reaches` in the file"
        return what, "fail", f"something else than this host answers it at {where}; {mend}"
    return what, "ok", f"it reaches {where} in {1e3 * probed.took_s:.1f} ms"


def advice(host: Host, address: str, port: int) -> str:
    """Return what to do where a host does not reach us. address, port: of ours; 0: any."""
    if host.spec.reaches:
        return f"is `reaches` right, and does that forward connections to {address} here?"
    origin = host.origin or address
    other = f", or --listen {origin}, from where SSH comes to it" * (origin != address)
    if port:
        return f"open TCP port {port} inbound on this host{other}"
    return (
        "open one TCP port inbound on this host, and name it, here and for `stepbus run`: "
        f"--listen {origin}:7447"
    )


def _comes(listener: socket.socket, proof: bytes) -> bool:
    """Return whether the proof comes in; strangers are passed over."""
    give_up_s = time.monotonic() + _PROOF_S
    with contextlib.suppress(OSError):
        while (left_s := give_up_s - time.monotonic()) > 0:
            listener.settimeout(left_s)
            link, _ = listener.accept()
            with link, contextlib.suppress(OSError):
                link.settimeout(_PROOF_S)
                if link.recv(len(proof), socket.MSG_WAITALL) == proof:
                    return True
    return False


def _times(host: Host) -> Row:
    """Measure the round trip, and the difference of the clocks."""
    rounds = []
    for _ in range(_ROUNDS):
        sent_s = time.time()
        clock_s = host.probe(wire.Probe()).clock_s
        came_s = time.time()
        rounds.append((came_s - sent_s, clock_s - (sent_s + came_s) / 2))
    trip_s, ahead_s = min(rounds)
    text = (
        f"round trip {1e3 * trip_s:.1f} ms by SSH; its clock is {abs(ahead_s):.3f} s "
        f"{'ahead' if ahead_s > 0 else 'behind'}, which changes no result"
    )
    return f"{host.name}, times", "ok", text


def _versions(table: Mapping[str, Mapping[str, str]]) -> Iterator[Row]:
    """Compare the versions. table: as of `compared`."""
    for name, is_same, words in compared(table):
        if is_same:
            yield name, "ok", words
        elif name in MUST_AGREE:
            yield name, "fail", f"{words}; install the same stepbus on all"
        else:
            yield name, "warn", f"{words}; results may differ in the last bit"
