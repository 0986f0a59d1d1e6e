"""Who may read what a view's server sends: browsers of this machine that have its address."""

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


class Door:
    """Lets in requests whose path begins with a secret, from pages of this server only.

    host: where the page listens. port: set once the server has it.
    """

    def __init__(self, host: str) -> None:
        self._host = host
        self._token = secrets.token_urlsafe(_TOKEN_BYTES)
        self.port = 0

    @property
    def address(self) -> str:
        """Return the address of the page, with the secret."""
        host = f"[{self._host}]" if ":" in self._host else self._host
        shown = "localhost" if self._host in _ALL else host
        return f"http://{shown}:{self.port}/{self._token}/"

    def guard(self, process: Process) -> Process:
        """Return `process` behind the door, which hands it paths without the secret."""

        def process_request(connection: Any, request: Any) -> Any:
            given, _, rest = request.path.removeprefix("/").partition("/")
            token, mark, query = given.partition("?")
            if not hmac.compare_digest(token.encode(), self._token.encode()):
                why = "Open the URL that `stepbus view` prints.\n"
                response = connection.respond(HTTPStatus.FORBIDDEN, why)
            elif not _is_from_here(request.headers):
                why = "A page of another server asks for this one.\n"
                response = connection.respond(HTTPStatus.FORBIDDEN, why)
            else:
                request.path = f"/{rest}{mark}{query}"
                response = process(connection, request)
            if response is not None:
                response.headers.update(_HEADERS)
            return response

        return process_request


def _is_from_here(headers: Any) -> bool:
    """Return whether a request comes from no page of another server."""
    host, origins = headers.get("Host"), headers.get_all("Origin")
    return all(origin in {f"http://{host}", f"https://{host}"} for origin in origins)
