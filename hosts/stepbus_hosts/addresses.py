"""Addresses of hosts, as users write them."""

import contextlib
import errno
import fcntl
import ipaddress
import os
import socket

from stepbus_orchestrator.scenario.model import LAST_TCP_PORT
from stepbus_schemas import WiringError

_GET_ADDRESS = 0x8915
"""`SIOCGIFADDR` of Linux."""


def parse_address(text: str) -> tuple[str, int]:
    """Return address and port of `192.0.2.7` or `192.0.2.7:7447`; 0: any port.

    Raises WiringError for a name, which may have several addresses, for all addresses at once, and
    for IPv6, to whose addresses Zenoh 1.10.2 opens no TLS link.
    """
    host, _, port = text.partition(":") if text.count(":") < 2 else (text.strip("[]"), "", "")
    try:
        address = ipaddress.ip_address(host.partition("]")[0])
        number = int(port or 0)
    except ValueError as exc:
        raise WiringError(
            f"{text!r} is no ADDRESS or ADDRESS:PORT, such as 192.0.2.7:7447"
        ) from exc
    if number not in range(LAST_TCP_PORT + 1):
        raise WiringError(f"{text!r}: a port is 1 to {LAST_TCP_PORT}; 0: any free one")
    own = ", ".join(own_addresses()) or "none"
    if address.version != 4:
        raise WiringError(
            f"{text!r}: Zenoh opens TLS links to IPv4 addresses only; this host has: {own}"
        )
    if address.is_unspecified or address.is_multicast:
        raise WiringError(f"{text!r} is of several networks; choose one; this host has: {own}")
    return host, number


def own_addresses() -> list[str]:
    """Return the addresses of this host that others can reach: one of each interface (Linux)."""
    found = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        for _, name in socket.if_nameindex():
            # It may have none.
            with contextlib.suppress(OSError):
                row = fcntl.ioctl(any_socket, _GET_ADDRESS, name.encode().ljust(256, b"\0"))
                found.append(socket.inet_ntoa(row[20:24]))
    return [one for one in found if not ipaddress.ip_address(one).is_loopback]


def open_port(address: str, port: int) -> socket.socket:
    """Listen on an address of this host; raises WiringError with what else to choose."""
    try:
        return socket.create_server((address, port))
    except OSError as exc:
        number = exc.errno or 0
        hint = {
            errno.EADDRINUSE: "another run or program has it; choose another port",
            errno.EACCES: "choose a port above 1023",
        }.get(
            number,
            f"addresses of this host: {', '.join(own_addresses()) or 'none'}; behind a router, "
            "--listen one of them, and say `reaches` in the file of --hosts",
        )
        raise WiringError(
            f"{address}:{port} cannot be opened here: {os.strerror(number)}; {hint}"
        ) from exc
