"""The ticket: what a process needs to find its run (P1)."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from stepbus_schemas import SPOKEN, UNDECODABLE, Protocols, WiringError, explained

TICKET_VARIABLE = "STEPBUS_TICKET"
_UNIX = "unixsock-stream/"


class Endpoint(msgspec.Struct, frozen=True, kw_only=True):
    """How one process reaches the bus (P2).

    listen: its own Zenoh endpoint. connect: endpoints of those it links to. user, password: its
    credentials. users: user → password this process lets in. settings: further Zenoh settings, by
    their path in Zenoh's own tree: certificates and access control.
    """

    listen: list[str]
    connect: list[str]
    low_latency: bool = True
    user: str | None = None
    password: str | None = None
    users: dict[str, str] = {}
    settings: dict[str, Any] = {}


class MessageFault(msgspec.Struct, frozen=True, kw_only=True):
    """A fault injected into the outputs of one step.

    type: `drop`, `delay`, `duplicate`, `reorder`, `corrupt` or `oversize`. duration_s: length of
    a delay [s].
    """

    type: str
    step: int
    duration_s: float = 0.0


class ProfileOrder(msgspec.Struct, frozen=True, kw_only=True):
    """What to measure of each step (`stepbus run --profile`).

    folder: of the profiles.
    """

    folder: str


class CheckpointOrder(msgspec.Struct, frozen=True, kw_only=True):
    """When to save the state, and from which to start (P16).

    every: at the first step at or after each multiple of this, 0: never [steps]. state: path of a
    state that this participant saved; empty: it starts at step 0. step: the one it does first then.
    """

    every: int = 0
    step: int = 0
    state: str = ""


NO_CHECKPOINTS = CheckpointOrder()


class Ticket(msgspec.Struct, frozen=True, kw_only=True):
    """The identity of a process, and its run.

    slots: folder with a file for each bulk output (P17); empty: content travels in messages.
    protocols: that the orchestrator speaks (P14.1).
    """

    run: str
    name: str
    token: str
    endpoint: Endpoint
    join_timeout_s: float = 10.0
    faults: list[MessageFault] = []
    profile: ProfileOrder | None = None
    checkpoint: CheckpointOrder = NO_CHECKPOINTS
    slots: str = ""
    protocols: Protocols = SPOKEN

    def save(self, path: Path) -> None:
        """Write the ticket as JSON, readable by its owner only."""
        path.touch(mode=0o600)
        path.write_bytes(msgspec.json.encode(self))


def unreachable(address: str, why: str, what: str = "is the run over") -> str:
    """Return that a run on another host cannot be reached, and what to check."""
    return f"{address} cannot be reached: {why}; {what}, or is the port closed by a firewall?"


def private_folder(endpoint: Endpoint) -> Path | None:
    """Return the private folder of a run, which is removed with it; None where that is unknown."""
    certificate = endpoint.settings.get("transport/link/tls/root_ca_certificate")
    if certificate is not None:
        return Path(certificate).parent
    addresses = [*endpoint.listen, *endpoint.connect]
    sockets = [Path(name[len(_UNIX) :]) for name in addresses if name.startswith(_UNIX)]
    return sockets[0].parent if sockets else None


def scratch_folder() -> Path | None:
    """Return a folder for temporary files that is removed with the run; None outside of a run.

    A program that is killed removes nothing itself.
    """
    if TICKET_VARIABLE not in os.environ:
        return None
    try:
        # The ticket itself may be anywhere, where the user has started the program.
        folder = private_folder(load_ticket().endpoint)
    except WiringError:
        return None
    return folder if folder is not None and folder.is_dir() else None


def load_ticket(environment: Mapping[str, str] = os.environ) -> Ticket:
    """Return the ticket named by the variable `STEPBUS_TICKET`.

    Raises WiringError when there is none, or when it is no ticket.
    """
    path = environment.get(TICKET_VARIABLE)
    if path is None:
        raise WiringError(
            f"{TICKET_VARIABLE} is not set: this program runs only as a participant; name it "
            "under `exec` in a scenario and start the scenario with `stepbus run`"
        )
    try:
        return msgspec.json.decode(Path(path).read_bytes(), type=Ticket)
    except (OSError, *UNDECODABLE) as exc:
        raise WiringError(f"{path} is not a valid ticket: {explained(exc)}") from exc
