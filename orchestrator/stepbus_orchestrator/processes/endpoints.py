"""The endpoints of a run: where each process listens, which ones it connects to, and its proof.

Credentials are made for one run and gone with it (P2.4). Each process proves its name: by a
password of its own on Unix sockets, by a certificate of the run's own authority on TCP. A guarded
Zenoh session then takes from a link only what that name may publish, so that no participant can
speak for another one. Without credentials there is no link at all.
"""

import contextlib
import secrets
import socket
import tempfile
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from stepbus_orchestrator.errors import BusFailed
from stepbus_orchestrator.scenario.model import Scenario, low_latency
from stepbus_participant import Endpoint

if TYPE_CHECKING:
    from trustme import CA

_SOCKET_PATH_BYTES = 107
_UNIX = "unixsock-stream/"

ORCHESTRATOR = "orchestrator"
CALLER = ".caller"
"""The caller of a run from outside (`stepbus call`); no participant's name has a leading dot."""

_OWN_KEYS = ("out", "ready", "log", "fault", "called", "checkpoint", "alive")
_CONTROL = ("start", "trigger", "stop", "call/*")
"""Keys of the orchestrator on which participants listen (P3.1)."""
_DECLARATIONS = (
    "declare_subscriber",
    "declare_queryable",
    "declare_liveliness_subscriber",
    "liveliness_query",
)
_ALL = (*_DECLARATIONS, "put", "delete", "query", "reply", "liveliness_token")


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """The endpoints of one run: each participant links to the orchestrator and those before it.

    caller: the endpoint of a caller from outside.
    """

    orchestrator: Endpoint
    participants: dict[str, Endpoint]
    caller: Endpoint


def private_folder() -> Path:
    """Make the run's private folder, for sockets and tickets (mode 0700).

    Raises BusFailed when the folder for temporary files cannot be written.
    """
    try:
        return Path(tempfile.mkdtemp(prefix="stepbus-"))
    except OSError as exc:
        raise BusFailed(
            f"cannot create a folder for sockets: {exc.strerror or exc}; set TMPDIR to a writable "
            "folder"
        ) from exc


def new_token() -> str:
    """Return a run's secret: 64 random bits, in hexadecimal."""
    return secrets.token_hex(8)


def make_mesh(
    scenario: Scenario,
    folder: Path,
    run: str | None,
    held: contextlib.ExitStack,
    *,
    is_star: bool = False,
    behind: Mapping[str, Collection[str]] = MappingProxyType({}),
) -> Mesh:
    """Return the endpoints of all processes of a run, with their credentials.

    folder: private, for sockets and certificates. run: names the key space, in which each
    participant may publish on its own keys only; None: on any key, as the conformance kit does,
    which speaks for several. held: what keeps the TCP ports from others. is_star: participants are
    linked to the orchestrator only. behind: gateway → participants that are linked to it only, from
    which it takes their certificates, and for which it speaks; it is linked to all others.

    Raises BusFailed when there is no room for a socket, no free port or no space in the folder.
    """
    distant = [name for names in behind.values() for name in names]
    specs = (spec.name for spec in scenario.participants)
    listening = [ORCHESTRATOR, *(name for name in specs if name not in distant)]
    names = [*listening, *behind, CALLER]
    settings: dict[str, dict[str, Any]] = {name: {} for name in names}
    access: Mapping[str, Any] = {}
    if scenario.bus.transport == "unix":
        addresses = [_unix(folder, index) for index in range(len(listening))]
        if run is not None:
            # A password names the end that opens a link to the end that accepts it, not the other
            # way round; there, it is the session that has a name. Its first digit is no zero.
            ids = {name: f"{secrets.randbits(127) | 1 << 127:032x}" for name in listening}
            settings |= {name: {"id": number} for name, number in ids.items()}
            access = _access_control(run, listening[1:], "usernames", ids, behind)
    else:
        ports = _ports(scenario.bus.port, len(listening), held)
        addresses = [f"tls/127.0.0.1:{port}" for port in ports]
        settings = certificates(names, folder)
        if run is not None:
            access = _access_control(run, listening[1:], "cert_common_names")
    users = {name: secrets.token_hex(16) for name in names}
    guarded = {"access_control": access} if access else {}
    endpoints = {
        name: Endpoint(
            listen=addresses[index : index + 1],
            connect=addresses[: min(index, 1) if is_star or name == CALLER else index],
            low_latency=low_latency(scenario),
            user=name,
            password=users[name],
            users=users if name != CALLER else {},
            settings={**settings[name], **guarded},
        )
        for index, name in enumerate(names)
    }
    return Mesh(
        orchestrator=endpoints.pop(ORCHESTRATOR),
        caller=endpoints.pop(CALLER),
        participants=endpoints,
    )


def _unix(folder: Path, index: int) -> str:
    path = folder / f"{index}.sock"
    if len(str(path).encode()) > _SOCKET_PATH_BYTES:
        raise BusFailed(
            f"{path}: the path of a Unix socket has at most {_SOCKET_PATH_BYTES} bytes; "
            "set TMPDIR to a shorter folder or use --set bus.transport=tcp"
        )
    return f"{_UNIX}{path}"


def _ports(base: int | None, count: int, held: contextlib.ExitStack) -> list[int]:
    """Return free TCP ports on loopback, from `base` on where it is given.

    Nobody is given one of them while its socket is held: a participant listens a moment later.
    """
    wanted = [0] * count if base is None else [base + index for index in range(count)]
    found = []
    try:
        for port in wanted:
            probe = held.enter_context(socket.socket(socket.AF_INET, socket.SOCK_STREAM))
            # As Zenoh does: it can listen beside this one, and where a connection has just closed.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(("127.0.0.1", port))
            found.append(probe.getsockname()[1])
    except OSError as exc:
        raise BusFailed(
            f"port {port} on 127.0.0.1 cannot be used: {exc.strerror}; the run needs "
            f"{count} ports, starting at bus.port; choose another bus.port, or omit it "
            "to use free ports"
        ) from exc
    return found


# --- credentials ---------------------------------------------------------------------------


def certificates(names: Iterable[str], folder: Path) -> dict[str, dict[str, Any]]:
    """Write a certificate for each name, and return the Zenoh settings that use it.

    folder: private; it gets the files, which are of no use once the run is over. Raises BusFailed
    when it has no space.
    """
    import trustme  # noqa: PLC0415  (only TCP needs it, and it loads all of cryptography)

    authority = trustme.CA()
    root = folder / "authority.pem"
    try:
        authority.cert_pem.write_to_path(root)
        return {name: _certificate(authority, name, folder, root) for name in names}
    except OSError as exc:
        raise BusFailed(
            f"cannot write the certificates of the run: {exc.strerror or exc}; set TMPDIR to a "
            "folder with free space"
        ) from exc


def _certificate(authority: "CA", name: str, folder: Path, root: Path) -> dict[str, Any]:
    issued = authority.issue_cert("127.0.0.1", common_name=name)
    chain, key = folder / f"{name}.crt", folder / f"{name}.key"
    issued.cert_chain_pems[0].write_to_path(chain)
    key.touch(mode=0o600)
    issued.private_key_pem.write_to_path(key)
    files = {"certificate": str(chain), "private_key": str(key)}
    return {
        "transport/link/tls/root_ca_certificate": str(root),
        **{f"transport/link/tls/{end}_{file}": path
           for end in ("listen", "connect") for file, path in files.items()},
        "transport/link/tls/enable_mtls": True,
        # All are on 127.0.0.1: only the common name distinguishes them.
        "transport/link/tls/verify_name_on_connect": False,
    }  # fmt: skip


def _access_control(
    run: str,
    participants: Iterable[str],
    proof: str,
    ids: Mapping[str, str] | None = None,
    behind: Mapping[str, Collection[str]] = MappingProxyType({}),
) -> Mapping[str, Any]:
    """Return Zenoh's access control for every session of a run.

    proof: `usernames` or `cert_common_names`, by which Zenoh knows who is at the other end. ids: of
    the sessions, by which it knows that where no proof was given: of those that a session connects
    to on Unix sockets. A proven participant is never taken for the orchestrator. behind: as of
    `make_mesh`.
    """
    keys = f"stepbus/{run}"
    distant = [name for names in behind.values() for name in names]
    speaks_for = {name: [name] for name in (*participants, *distant)}
    owned = {
        name: [*(f"{keys}/{key}/{name}" for key in _OWN_KEYS), f"{keys}/bulk/{name}/**"]
        for name in speaks_for
    }
    speaks_for |= {name: list(names) for name, names in behind.items()}
    rules = [
        _rule("egress", "egress", _ALL, ["**"]),
        _rule("listen", "ingress", _DECLARATIONS, [f"{keys}/**"]),
        _rule("join", "ingress", ("query",), [f"{keys}/join"]),
        _rule("call", "ingress", ("query",), [f"{keys}/call"]),
        _rule(ORCHESTRATOR, "ingress", _ALL, [f"{keys}/**"]),
        *(
            _rule(f"own {name}", "ingress", ("put", "delete", "liveliness_token"), own)
            for name, own in owned.items()
        ),
    ]
    subjects = [
        {"id": name, "cert_common_names" if name in distant else proof: [name]}
        for name in (ORCHESTRATOR, CALLER, *speaks_for)
    ]
    policies = [
        {"subjects": ["anyone"], "rules": ["egress"]},
        {"subjects": [ORCHESTRATOR], "rules": [ORCHESTRATOR]},
        {"subjects": [CALLER], "rules": ["call"]},
        *(
            {"subjects": [name], "rules": ["listen", "join", *(f"own {one}" for one in names)]}
            for name, names in speaks_for.items()
        ),
    ]
    if ids is not None:
        control = [f"{keys}/{key}" for key in _CONTROL]
        rules.append(_rule("control", "ingress", ("put",), control, "deny"))
        for policy in policies[1:]:
            (name,) = policy["subjects"]
            if name in ids:
                subjects.append({"id": f"session {name}", "zids": [ids[name]]})
                policy["subjects"] = [name, f"session {name}"]
        policies.append({"subjects": list(speaks_for), "rules": ["control"]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": "anyone"}, *subjects],
        "policies": policies,
    }


def _rule(
    name: str, flow: str, messages: Iterable[str], keys: list[str], permission: str = "allow"
) -> dict[str, Any]:
    return {
        "id": name,
        "flows": [flow],
        "messages": list(messages),
        "permission": permission,
        "key_exprs": keys,
    }
