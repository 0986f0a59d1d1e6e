"""The endpoints of a run: where each process listens, and which ones it connects to."""

from __future__ import annotations

import secrets
import socket
import tempfile
from dataclasses import dataclass
from pathlib import Path

from stepbus_orchestrator.errors import BusFailed
from stepbus_orchestrator.scenario import Scenario
from stepbus_participant import Endpoint

ORCHESTRATOR = "orchestrator"
_SOCKET_PATH_BYTES = 107


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """The endpoints of one run: each process connects to the orchestrator and those before it."""

    orchestrator: Endpoint
    participants: dict[str, Endpoint]


def private_folder() -> Path:
    """Make the run's private folder, for sockets and tickets (mode 0700).

    Raises BusFailed when the folder for temporary files cannot be written.
    """
    try:
        return Path(tempfile.mkdtemp(prefix="stepbus-"))
    except OSError as exc:
        raise BusFailed(
            f"cannot make a folder for sockets: {exc.strerror or exc}; set TMPDIR to one that "
            "can be written"
        ) from exc


def make_mesh(scenario: Scenario, folder: Path, token: str) -> Mesh:
    """Return the endpoints of the orchestrator and all participants.

    Raises BusFailed when a socket's path is too long or there is no free port.
    """
    bus = scenario.bus
    names = [ORCHESTRATOR, *(spec.name for spec in scenario.participants)]
    if bus.transport == "unix":
        addresses = [_unix(folder, index) for index in range(len(names))]
    else:
        addresses = [f"tcp/127.0.0.1:{port}" for port in _ports(bus.port, len(names))]
    users = {} if bus.transport == "unix" else dict.fromkeys(names, token)
    endpoints = {
        name: Endpoint(
            listen=[addresses[index]],
            connect=addresses[:index],
            low_latency=low_latency(scenario),
            user=name if users else None,
            password=token if users else None,
            users=users,
        )
        for index, name in enumerate(names)
    }
    return Mesh(orchestrator=endpoints.pop(ORCHESTRATOR), participants=endpoints)


def low_latency(scenario: Scenario) -> bool:
    """Return whether to use Zenoh's low-latency transport.

    It silently loses messages over 64 KiB, so scenarios with bulk ports do not use it.
    """
    if scenario.bus.low_latency is not None:
        return scenario.bus.low_latency
    specs = scenario.participants
    return not any(output.bulk for spec in specs for output in spec.outputs.values())


def _unix(folder: Path, index: int) -> str:
    path = folder / f"{index}.sock"
    if len(str(path).encode()) > _SOCKET_PATH_BYTES:
        raise BusFailed(
            f"{path}: a Unix socket's path holds at most {_SOCKET_PATH_BYTES} bytes; "
            "set TMPDIR to a shorter folder or use `--set bus.transport=tcp`"
        )
    return f"unixsock-stream/{path}"


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


def new_token() -> str:
    """Return a run's secret: 64 random bits, in hexadecimal."""
    return secrets.token_hex(8)
