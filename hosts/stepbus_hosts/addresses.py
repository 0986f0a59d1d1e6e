"""Addresses of hosts, as users write them."""

import ipaddress
import socket

from stepbus_orchestrator.scenario.model import LAST_TCP_PORT
from stepbus_schemas import WiringError


def parse_address(text: str) -> tuple[str, int]:
    """Return address and port of `192.0.2.7` or `192.0.2.7:7447`; 0: any port.

    Raises WiringError for a name, which may have several addresses, for all addresses at once, and
    for IPv6, to whose addresses Zenoh 1.10.2 opens no TLS link.
    """
    host, _, port = text.partition(":") if text.count(":") < 2 else (text.strip("[]"), "", "")
    try:
        address = ipaddress.ip_address(host.partition("]")[0])
        number = int(port or 0)
        if number not in range(LAST_TCP_PORT + 1):
            raise ValueError(number)  # noqa: TRY301  (as for what is no number)
    except ValueError as exc:
        raise WiringError(
            f"{text!r} is no ADDRESS or ADDRESS:PORT, such as 192.0.2.7:7447"
        ) from exc
    own = ", ".join(own_addresses()) or "none that its name tells"
    if address.version != 4:
        raise WiringError(
            f"{text!r}: Zenoh opens TLS links to IPv4 addresses only; this host has: {own}"
        )
    if address.is_unspecified:
        raise WiringError(f"{text!r} is every network at once; choose one; this host has: {own}")
    return host, number


def own_addresses() -> list[str]:
    """Return the addresses of this host that others can reach, as far as its name says."""
    rows = socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET, socket.SOCK_STREAM)
    found = dict.fromkeys(str(row[4][0]) for row in rows)
    return [one for one in found if not ipaddress.ip_address(one).is_loopback]
