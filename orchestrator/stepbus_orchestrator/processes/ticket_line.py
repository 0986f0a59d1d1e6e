"""A ticket on another host: as one line from a terminal, and whether its run can be reached."""

import base64
import binascii
import contextlib
import fcntl
import os
import socket
import ssl
import zlib
from collections.abc import Iterator

import msgspec

from stepbus_participant import Ticket, unreachable
from stepbus_schemas import WiringError

MARK = "ticket:"
"""What a line begins with, and no path that a run prints."""
_REACH_S = 5.0
_MOST_BYTES = 1 << 20
_TLS = "transport/link/tls/"
_FIRST_DESCRIPTOR = 100
"""Programs use small numbers for their own; the bridge's are 3 and 4."""


def line_of(ticket: Ticket) -> str:
    """Return a ticket as one word, which no shell changes."""
    packed = zlib.compress(msgspec.json.encode(ticket), 9)
    return MARK + base64.urlsafe_b64encode(packed).decode()


def content_of(line: str) -> bytes:
    """Return the content of the ticket in a line; raises WiringError where it is not whole."""
    try:
        packed = base64.b64decode(line.removeprefix(MARK), b"-_", validate=True)
        unpacking = zlib.decompressobj()
        content = unpacking.decompress(packed, _MOST_BYTES)
        if unpacking.eof:
            return content
    except (binascii.Error, ValueError, zlib.error):
        pass
    raise WiringError(
        f"{MARK}…: this is not the whole line of a ticket; copy it once more, from `{MARK}` to its "
        "end"
    )


def path_of(content: bytes) -> str:
    """Return the path of a file in memory, which ends with this process and its program.

    All that this user starts on this host can read it there, whatever it inherits.
    """
    with _in_memory(content) as file:
        kept = fcntl.fcntl(file, fcntl.F_DUPFD, _FIRST_DESCRIPTOR)
    return f"/proc/{os.getpid()}/fd/{kept}"


@contextlib.contextmanager
def _in_memory(content: bytes) -> Iterator[int]:
    """Yield the descriptor of a private file that has no name."""
    with os.fdopen(os.memfd_create("ticket"), "wb", buffering=0) as file:
        os.fchmod(file.fileno(), 0o600)
        file.write(content)
        yield file.fileno()


def check_reachable(ticket: Ticket) -> None:
    """Raise WiringError where the run of a ticket from another host cannot be reached.

    With the ticket's own certificate, so that the run counts no stranger. Tickets of runs on this
    host go with these.
    """
    settings = ticket.endpoint.settings
    if f"{_TLS}root_ca_certificate_base64" not in settings:
        return
    pems = {
        name: base64.b64decode(settings[f"{_TLS}{name}_base64"])
        for name in ("root_ca_certificate", "connect_private_key", "connect_certificate")
    }
    context = ssl.create_default_context(cadata=pems["root_ca_certificate"].decode())
    context.check_hostname = False
    with _in_memory(pems["connect_private_key"] + pems["connect_certificate"]) as file:
        context.load_cert_chain(f"/proc/self/fd/{file}")
    address = ticket.endpoint.connect[0].removeprefix("tls/")
    host, _, port = address.rpartition(":")
    try:
        with (
            socket.create_connection((host.strip("[]"), int(port)), _REACH_S) as link,
            context.wrap_socket(link),
        ):
            return
    except ssl.SSLError as exc:
        raise WiringError(
            f"{address} answers, but not as the run of this ticket; is that over? Get the ticket "
            "of this one"
        ) from exc
    except OSError as exc:
        why = exc.strerror or f"no answer within {_REACH_S:g} s"
        raise WiringError(unreachable(address, why)) from exc
