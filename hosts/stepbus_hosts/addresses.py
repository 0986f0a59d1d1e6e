"""Addresses, as users write them and as they stand in an endpoint."""

import ipaddress
import socket

from stepbus_schemas import WiringError


def parse_address(text: str) -> tuple[str, int]:
    """Return address and port of `192.0.2.7`, `192.0.2.7:7447` or `[2001:db8::7]:7447`.

    Raises WiringError for a name, which may have several addresses, and for all addresses at once.
    """
    host, _, port = text.rpartition(":") if text.count(":") == 1 or "]:" in text else (text, "", "")
    host = host.strip("[]")
    try:
        address = ipaddress.ip_address(host)
        number = int(port or 0)
    except ValueError as exc:
        raise WiringError(
            f"{text!r} is no ADDRESS or ADDRESS:PORT, such as 192.0.2.7:7447"
        ) from exc
    if address.is_unspecified:
        own = ", ".join(own_addresses()) or "this host has none"
        raise WiringError(f"{text!r} is every network at once; choose one address ({own})")
    return host, number


def own_addresses() -> list[str]:
    """Return the addresses of this host that others can reach, as far as its name says."""
    rows = socket.getaddrinfo(socket.gethostname(), None, proto=socket.IPPROTO_TCP)
    found = dict.fromkeys(str(row[4][0]) for row in rows)
    return [one for one in found if not ipaddress.ip_address(one.partition("%")[0]).is_loopback]


def bracketed(host: str) -> str:
    """Return a host as it stands before a port."""
    return f"[{host}]" if ":" in host else host
