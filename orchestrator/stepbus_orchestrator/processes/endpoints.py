"""The endpoints of a run: where each process listens, and which ones it connects to."""

import secrets
import socket
import tempfile
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stepbus_orchestrator.errors import BusFailed, argument
from stepbus_orchestrator.processes.credentials import (
    CALLER,
    ORCHESTRATOR,
    access_control,
    certificates,
    identities,
    passwords,
)
from stepbus_orchestrator.processes.port_users import PortUsers
from stepbus_orchestrator.scenario.model import Scenario, low_latency
from stepbus_participant import Endpoint

_SOCKET_PATH_BYTES = 107
_NOT_IN_ADDRESSES = "#?"
_UNIX = "unixsock-stream/"


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """The endpoints of one run: each participant links to the orchestrator and those before it.

    folder: the private one. caller: the endpoint of a caller from outside. users: of its TCP ports.
    tickets: of participants that somebody else starts, which are elsewhere.
    """

    folder: Path
    orchestrator: Endpoint
    participants: dict[str, Endpoint]
    caller: Endpoint
    users: PortUsers
    tickets: dict[str, Path] = field(default_factory=dict)

    def lost(self, name: str | None, alive: Collection[str]) -> Path | None:
        """Return what a participant needs for its start and somebody has removed; None: nothing.

        name: it has been started; None: none has. alive: who is on the bus, with its socket.
        """
        needed = [self.folder]
        if name is not None:
            ticket = self.tickets.get(name, self.folder / f"{name}.ticket")
            needed += [] if name in alive else [ticket]
            up = [self.orchestrator, *(self.participants[other] for other in alive)]
            sockets = [address for endpoint in up for address in endpoint.listen]
            needed += [Path(a[len(_UNIX) :]) for a in sockets if a.startswith(_UNIX)]
            # Zenoh reads certificates anew for each link.
            endpoints = [self.orchestrator, *self.participants.values()]
            values = [str(value) for endpoint in endpoints for value in endpoint.settings.values()]
            needed += [Path(value) for value in values if value.startswith(str(self.folder))]
        return next((path for path in needed if not path.exists()), None)


def private_folder() -> Path:
    """Make the run's private folder, for sockets and tickets (mode 0700).

    Raises BusFailed when the folder for temporary files cannot be written.
    """
    try:
        tempfile.gettempdir().encode()
        return Path(tempfile.mkdtemp(prefix="stepbus-"))
    except (OSError, UnicodeEncodeError) as exc:
        reason = exc.strerror or exc if isinstance(exc, OSError) else "its name is no UTF-8"
        raise BusFailed(
            f"cannot make a folder for sockets: {reason}; set TMPDIR to one that can be written"
        ) from exc


def gone(path: Path) -> str:
    """Return the sentence about something in the private folder that is there no more."""
    return f"{path}, which is private to the run, is gone: did somebody remove it?"


def make_mesh(scenario: Scenario, folder: Path, run: str | None, *, is_star: bool = False) -> Mesh:
    """Return the endpoints of all processes of a run, with their credentials.

    folder: private, for sockets and certificates. run: names the key space, in which each
    participant may publish on its own keys only; None: on any key, as the conformance kit does,
    which speaks for several. is_star: participants are linked to the orchestrator only.

    Raises BusFailed when there is no room for a socket, no free port or no space in the folder.
    """
    names = [ORCHESTRATOR, *(spec.name for spec in scenario.participants)]
    is_unix = scenario.bus.transport == "unix"
    if is_unix:
        addresses = [_unix(folder, index) for index in range(len(names))]
    else:
        addresses = [f"tls/127.0.0.1:{port}" for port in _ports(scenario.bus.port, len(names))]
    users = passwords([*names, CALLER])
    settings = _settings(folder, run, names, is_unix=is_unix)
    endpoints = {
        name: Endpoint(
            listen=addresses[index : index + 1],
            connect=addresses[: min(index, 1) if is_star or name == CALLER else index],
            low_latency=low_latency(scenario),
            user=name,
            password=users[name],
            users=users if name != CALLER else {},
            settings=settings[name],
        )
        for index, name in enumerate([*names, CALLER])
    }
    return Mesh(
        folder=folder,
        users=PortUsers([port for one in endpoints.values() for port in tcp_ports(one)]),
        orchestrator=endpoints.pop(ORCHESTRATOR),
        caller=endpoints.pop(CALLER),
        participants=endpoints,
    )


def _settings(
    folder: Path, run: str | None, names: list[str], *, is_unix: bool
) -> dict[str, dict[str, Any]]:
    """Return the further Zenoh settings of each process."""
    everybody = [*names, CALLER]
    if not is_unix:
        own = _certificates(everybody, folder)
        access = {} if run is None else access_control(run, names[1:], "cert_common_names")
    elif run is None:
        own, access = {name: {} for name in everybody}, {}
    else:
        # A password names the one who opens a link to the one who accepts it, not the other way
        # round; there, it is the session that has a name.
        ids = identities(names)
        own = {name: {"id": ids[name]} if name in ids else {} for name in everybody}
        access = access_control(run, names[1:], "usernames", ids)
    if run is None:
        return own
    return {name: {**settings, "access_control": access} for name, settings in own.items()}


def _certificates(names: list[str], folder: Path) -> dict[str, dict[str, Any]]:
    try:
        return certificates(names, folder)
    except OSError as exc:
        hint = "set TMPDIR to a folder with room" if folder.is_dir() else gone(folder)
        raise BusFailed(
            f"cannot write the certificates of the run: {exc.strerror or exc}; {hint}"
        ) from exc


def _unix(folder: Path, index: int) -> str:
    path = folder / f"{index}.sock"
    if len(str(path).encode()) > _SOCKET_PATH_BYTES:
        raise BusFailed(
            f"{path}: a Unix socket's path holds at most {_SOCKET_PATH_BYTES} bytes; "
            f"set TMPDIR to a shorter folder or use {argument('--set', value='bus.transport=tcp')}"
        )
    if odd := set(str(path)) & set(_NOT_IN_ADDRESSES):
        raise BusFailed(
            f"{path}: an address of Zenoh cannot hold {' '.join(sorted(odd))}; set TMPDIR to a "
            f"folder without, or use {argument('--set', value='bus.transport=tcp')}"
        )
    return f"{_UNIX}{path}"


def _ports(base: int | None, count: int) -> list[int]:
    """Return free TCP ports on loopback, from `base` on where it is given."""
    wanted = [0] * count if base is None else [base + index for index in range(count)]
    held: list[socket.socket] = []
    try:
        for port in wanted:
            probe = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
            held.append(probe)
            # As Zenoh does: a port whose last connection has only just closed is free.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(("127.0.0.1", port))
        return [probe.getsockname()[1] for probe in held]
    except OSError as exc:
        raise BusFailed(
            f"port {port} on 127.0.0.1 cannot be used: {exc.strerror}; the run needs "
            f"{count} ports from bus.port on; choose another or leave it out for free ones"
        ) from exc
    finally:
        for probe in held:
            probe.close()


def tcp_ports(endpoint: Endpoint) -> list[int]:
    """Return the ports that an endpoint listens on, where it does so over TCP."""
    addresses = [address for address in endpoint.listen if address.startswith("tls/")]
    return [int(address.rpartition(":")[2]) for address in addresses]


def new_token() -> str:
    """Return a run's secret: 64 random bits, in hexadecimal."""
    return secrets.token_hex(8)
