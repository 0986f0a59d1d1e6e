"""Who may read what a server of a view sends: this machine, and who knows the address."""

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
_ALL = ("0.0.0.0", "::")  # noqa: S104  (compared with, not bound)

Process = Callable[[Any, Any], Any]
"""What websockets asks of every request: (connection, request) → a response, or None to go on."""


def new_token() -> str:
    """Return a token that nobody can guess."""
    return secrets.token_urlsafe(_TOKEN_BYTES)


def listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens; port 0: any that is free.

    Raises WiringError for a port that is taken or forbidden, and a host not of this machine.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family)
    except OSError as exc:
        if exc.errno == errno.EADDRINUSE:
            why = f"port {port} of {host} is taken; choose another, or none"
            raise WiringError(why) from exc
        why = exc.strerror or str(exc)
        raise WiringError(f"cannot listen on {host}, port {port}: {why}") from exc


def shown_host(host: str) -> str:
    """Return a host as an address has it."""
    return "localhost" if host in _ALL else f"[{host}]" if ":" in host else host


def open_in_browser(address: str) -> None:
    """Open an address with a token in the browser, whose command line every user can read.

    So it gets the path of a file that leads there, which only this user can read.
    """
    folder = Path(tempfile.mkdtemp(prefix="stepbus-view-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    file = folder / "open.html"
    write_file(file, _REDIRECT.format(address=html.escape(address)).encode(), 0o600)
    webbrowser.open(file.as_uri())


def only_with(token: str, process: Process) -> Process:
    """Return what refuses each request without the token, and passes on the rest without it."""

    def process_request(connection: Any, request: Any) -> Any:
        given, _, rest = request.path.removeprefix("/").partition("/")
        name, mark, query = given.partition("?")
        if not hmac.compare_digest(name.encode(), token.encode()):
            return connection.respond(HTTPStatus.FORBIDDEN, "Open the address with its token.\n")
        request.path = f"/{rest}{mark}{query}"
        return process(connection, request)

    return process_request
