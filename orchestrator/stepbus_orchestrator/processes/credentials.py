"""Who each process of a run is, how it proves that, and on which keys it may speak (P2.4, P2.8).

Credentials are made for one run and gone with it. Each process proves its name: by a password of
its own on Unix sockets, by a certificate of the run's own authority on TCP. A guarded Zenoh session
then takes from a link only what that name may publish, so that no participant can speak for
another one. Without credentials there is no link at all.
"""

import secrets
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trustme import CA

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


def passwords(names: Iterable[str]) -> dict[str, str]:
    """Return a random password for each name."""
    return {name: secrets.token_hex(16) for name in names}


def certificates(names: Iterable[str], folder: Path) -> dict[str, dict[str, Any]]:
    """Write a certificate for each name, and return the Zenoh settings that use it.

    folder: private; it gets the files, which are of no use once the run is over.
    """
    import trustme  # noqa: PLC0415  (only TCP needs it, and it loads all of cryptography)

    authority = trustme.CA()
    root = folder / "authority.pem"
    authority.cert_pem.write_to_path(root)
    return {name: _certificate(authority, name, folder, root) for name in names}


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


def identities(names: Iterable[str]) -> dict[str, str]:
    """Return a random identity of a Zenoh session for each name; the first digit is no zero."""
    return {name: f"{secrets.randbits(127) | 1 << 127:032x}" for name in names}


def access_control(
    run: str, participants: Iterable[str], proof: str, ids: Mapping[str, str] | None = None
) -> Mapping[str, Any]:
    """Return Zenoh's access control for every session of a run.

    proof: `usernames` or `cert_common_names`, by which Zenoh knows who is at the other end. ids: of
    the sessions, by which it knows that where no proof was given: of those that a session connects
    to on Unix sockets. Whoever has proved to be a participant is never taken for the orchestrator.
    """
    keys = f"stepbus/{run}"
    owned = {name: _owned_keys(keys, name) for name in participants}
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
    subjects = [{"id": name, proof: [name]} for name in (ORCHESTRATOR, CALLER, *owned)]
    policies = [
        {"subjects": ["anyone"], "rules": ["egress"]},
        {"subjects": [ORCHESTRATOR], "rules": [ORCHESTRATOR]},
        {"subjects": [CALLER], "rules": ["call"]},
        *({"subjects": [name], "rules": ["listen", "join", f"own {name}"]} for name in owned),
    ]
    if ids is not None:
        control = [f"{keys}/{key}" for key in _CONTROL]
        rules.append(_rule("control", "ingress", ("put",), control, "deny"))
        for policy in policies[1:]:
            (name,) = policy["subjects"]
            if name in ids:
                subjects.append({"id": f"session {name}", "zids": [ids[name]]})
                policy["subjects"] = [name, f"session {name}"]
        policies.append({"subjects": list(owned), "rules": ["control"]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": "anyone"}, *subjects],
        "policies": policies,
    }


def _owned_keys(keys: str, name: str) -> list[str]:
    """Return the keys of the protocol that one participant publishes on (P3.1)."""
    return [*(f"{keys}/{key}/{name}" for key in _OWN_KEYS), f"{keys}/bulk/{name}/**"]


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
