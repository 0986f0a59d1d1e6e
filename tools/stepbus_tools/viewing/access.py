"""Access to the server of a view: only requests with its token, from pages of this server."""

import atexit
import errno
import hmac
import html
import secrets
import shutil
import socket
import tempfile
import webbrowser
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path
from typing import Any

from stepbus_participant import write_file
from stepbus_schemas import WiringError

LOOPBACK = "127.0.0.1"
_TOKEN_BYTES = 16
_REDIRECT = """<!doctype html><meta charset="utf-8"><meta name="referrer" content="no-referrer">
<meta http-equiv="refresh" content="0; url={address}">
<title>stepbus</title><a href="{address}">the page of the run</a>
"""
_HEADERS = {
    "Cache-Control": "no-store",
    # viser unpacks its own script into the page, and evaluates Markdown; it loads nothing.
    "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; worker-src blob:; "
    "connect-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
_ALL = ("0.0.0.0", "::")  # noqa: S104  (compared with, not bound)

Process = Callable[[Any, Any], Any]
"""What websockets asks of every request: (connection, request) → a response, or None to go on."""


def listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens; port 0: any that is free.

    Raises WiringError for a port that is taken or forbidden, and a host not of this machine.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family)
    except OSError as exc:
        if exc.errno == errno.EADDRINUSE:
            why = f"port {port} of {host} is in use; choose another, or omit it for a free one"
            raise WiringError(why) from exc
        why = exc.strerror or str(exc)
        raise WiringError(f"cannot listen on {host}, port {port}: {why}") from exc


def open_in_browser(address: str) -> None:
    """Open an address with a token in the browser, whose command line every user can read.

    So it gets the path of a file that leads there, which only this user can read.
    """
    folder = Path(tempfile.mkdtemp(prefix="stepbus-view-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    file = folder / "open.html"
    write_file(file, _REDIRECT.format(address=html.escape(address)).encode(), 0o600)
    webbrowser.open(file.as_uri())


def new_token() -> str:
    """Return a token that cannot be guessed."""
    return secrets.token_urlsafe(_TOKEN_BYTES)


def address_of(host: str, port: int, token: str) -> str:
    """Return the address of a page."""
    shown = "localhost" if host in _ALL else f"[{host}]" if ":" in host else host
    return f"http://{shown}:{port}/{token}/"


def only_with(token: str, process: Process) -> Process:
    """Return a `process` for requests whose path begins with a token, from pages of its server.

    `process` gets paths without the token; all other requests are refused.
    """

    def process_request(connection: Any, request: Any) -> Any:
        given, _, rest = request.path.removeprefix("/").partition("/")
        name, mark, query = given.partition("?")
        host, origins = request.headers.get("Host"), request.headers.get_all("Origin")
        if not hmac.compare_digest(name.encode(), token.encode()):
            why = "Open the URL that `stepbus view` prints.\n"
            response = connection.respond(HTTPStatus.FORBIDDEN, why)
        elif not all(origin in {f"http://{host}", f"https://{host}"} for origin in origins):
            why = "A page of another server asks for this one.\n"
            response = connection.respond(HTTPStatus.FORBIDDEN, why)
        else:
            request.path = f"/{rest}{mark}{query}"
            response = process(connection, request)
        if response is not None:
            response.headers.update(_HEADERS)
        return response

    return process_request
