"""Somebody on the network who is not invited: `python outsider.py WHAT ADDRESS PORT [TICKET]`.

It gets ready, says so, and acts when its standard input closes; then it says what it has come to.
"""

import contextlib
import random
import socket
import ssl
import sys
import time

import trustme

from stepbus_participant import BusError, ZenohBus, load_ticket
from stepbus_schemas import encoding_of

_WORDS = (
    b"",
    b"GET / HTTP/1.1\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
    bytes(70_000),
)
_SILENT_S = 2.0


def garbage(address, port):
    """Talk nonsense on many connections, hang up in the midst of some, say nothing on others."""
    kept = [socket.create_connection((address, port), 20) for _ in range(20)]
    for number in range(40):
        with socket.create_connection((address, port), 20) as link, contextlib.suppress(OSError):
            link.sendall(
                _WORDS[number % len(_WORDS)] + random.Random(number).randbytes(number * 50)
            )
    time.sleep(_SILENT_S)
    for link in kept:
        link.close()
    return f"{len(kept)} kept"


def no_certificate(address, port):
    return _handshake(address, port, lambda context: None)


def other_authority(address, port):
    """Show a certificate of another authority with the name of a participant."""
    issued = trustme.CA().issue_cert("127.0.0.1", common_name="controller")
    return _handshake(address, port, issued.configure_cert)


def _handshake(address, port, prepare):
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    prepare(context)
    try:
        with (
            socket.create_connection((address, port), 20) as link,
            context.wrap_socket(link) as tls,
        ):
            tls.sendall(b"hello")
            return f"let in: {tls.recv(100)!r}"
    except OSError as exc:
        return f"refused: {exc}"


def _bus(path, *, as_another_session=False):
    ticket = load_ticket({"STEPBUS_TICKET": path})
    if as_another_session:
        del ticket.endpoint.settings["id"]
    try:
        return ticket, ZenohBus(ticket.endpoint, ticket.run)
    except BusError as exc:
        sys.exit(print(f"refused: {exc}"))


def old_ticket(_address, _port, path):
    _bus(path)[1].close()
    return "let in"


def other_key(_address, _port, path):
    """Publish as another participant, over and over, with the token of the run."""
    ticket, bus = _bus(path, as_another_session=True)
    put = bus.publisher("out/plant", encoding_of("Outputs/1"))
    for _ in range(50):
        put(b"\x00" * 40, attachment=bytes(8) + ticket.token.encode())
        time.sleep(0.02)
    bus.close()
    return "has published"


if __name__ == "__main__":
    name, address, port, *rest = sys.argv[1:]
    print("ready", flush=True)
    sys.stdin.read()
    print(globals()[name](address, int(port), *rest), flush=True)
