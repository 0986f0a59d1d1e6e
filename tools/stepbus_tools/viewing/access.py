"""Who may read what a view's server sends: this machine, and users who know the address."""

import atexit
import errno
import hmac
import html
import ipaddress
import secrets
import shutil
import socket
import tempfile
import webbrowser
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from stepbus_participant import write_file
from stepbus_schemas import WiringError

LOOPBACK = "127.0.0.1"
_TOKEN_BYTES = 16
_REDIRECT = """<!doctype html><meta charset="utf-8"><meta name="referrer" content="no-referrer">
<meta http-equiv="refresh" content="0; url={address}">
<title>stepbus</title><a href="{address}">the page of the run</a>
"""
_COOKIE = "stepbus"
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
_USED = "This URL has already been used once. Open the new one that `stepbus view` printed.\n"
_UNKNOWN = "This browser has no access. Open the URL that `stepbus view` prints.\n"
_ALL = ("0.0.0.0", "::")  # noqa: S104  (compared with, not bound)

Process = Callable[[Any, Any], Any]
"""What websockets asks of every request: (connection, request) → a response, or None to go on."""


def new_token() -> str:
    """Return a token that cannot be guessed."""
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
            why = f"port {port} of {host} is in use; choose another, or omit it for a free one"
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


class Door:
    """Lets in one browser with each address: its token works once, from then on a cookie counts.

    So an address found in a history, or in the list of processes, is worth nothing.
    host: where the page listens. tell: gets a new address whenever one comes that has been used,
    unless there is one that waits: the user has another browser, or others have read the address.
    """

    def __init__(self, host: str, tell: Callable[[str], None]) -> None:
        self._host = host
        self._tell = tell
        # The ports of a host share their cookies: another server gets this one for this path only.
        self._room, self._cookie = new_token(), new_token()
        self._fresh: list[str] = []
        self._used: list[str] = []
        self.port = 0

    def new_address(self) -> str:
        """Return an address that opens the page once."""
        token = new_token()
        self._fresh.append(token)
        return f"http://{shown_host(self._host)}:{self.port}/{token}/"

    def guard(self, process: Process) -> Process:
        """Return what refuses strangers, and passes on other requests without their first name."""
        guarded = _guarded(process, self._answer)

        def process_request(connection: Any, request: Any) -> Any:
            response = guarded(connection, request)
            if response is not None:
                response.headers.update(_HEADERS)
            return response

        return process_request

    def _answer(self, connection: Any, headers: Any, name: str) -> Any:
        """Return the answer to a request; None: it comes from a browser that was let in."""
        if not self._is_addressed_here(headers):
            return connection.respond(HTTPStatus.FORBIDDEN, "This page has another URL.\n")
        if _is_one_of(name, [self._room]) and self._has_cookie(headers):
            return None
        if _is_one_of(name, self._fresh):
            return self._let_in(connection, name)
        if not _is_one_of(name, self._used):
            return connection.respond(HTTPStatus.FORBIDDEN, _UNKNOWN)
        if not self._fresh:
            self._tell(self.new_address())
        return connection.respond(HTTPStatus.FORBIDDEN, _USED)

    def _let_in(self, connection: Any, token: str) -> Any:
        self._fresh.remove(token)
        self._used.append(token)
        # No 303: where a file or another page has led here, the browser would send no cookie there.
        page = _REDIRECT.format(address=f"/{self._room}/")
        response = connection.respond(HTTPStatus.OK, page)
        del response.headers["Content-Type"]
        response.headers["Content-Type"] = "text/html; charset=utf-8"
        response.headers["Set-Cookie"] = (
            f"{_COOKIE}={self._cookie}; Path=/{self._room}; HttpOnly; SameSite=Strict"
        )
        return response

    def _is_addressed_here(self, headers: Any) -> bool:
        """Return whether a request names this machine, and comes from no page of another server.

        A name of the attacker's that leads to this machine (DNS rebinding) is neither an IP address
        nor one of ours. Ports are not compared: the page may have been forwarded.
        """
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        return (
            len(hosts) == 1
            and self._is_ours(hosts[0])
            and all(origin in {f"http://{hosts[0]}", f"https://{hosts[0]}"} for origin in origins)
        )

    def _is_ours(self, host: str) -> bool:
        ours = {"localhost", self._host.lower(), socket.gethostname().lower()}
        try:
            name = urlsplit(f"//{host}").hostname or ""
            return name in ours or bool(ipaddress.ip_address(name))
        except ValueError:
            return False

    def _has_cookie(self, headers: Any) -> bool:
        pairs = [pair.strip() for line in headers.get_all("Cookie") for pair in line.split(";")]
        return any(_is_one_of(pair, [f"{_COOKIE}={self._cookie}"]) for pair in pairs)


def only_with(token: str, process: Process) -> Process:
    """Return what refuses each request without the token, and passes on the rest without it."""

    def answer(connection: Any, _headers: Any, name: str) -> Any:
        if _is_one_of(name, [token]):
            return None
        return connection.respond(HTTPStatus.FORBIDDEN, "Open the URL with its token.\n")

    return _guarded(process, answer)


def _guarded(process: Process, answer: Callable[[Any, Any, str], Any]) -> Process:
    """Return what passes on requests that have no answer yet, without the first name of the path.

    answer: takes connection, headers and that name.
    """

    def process_request(connection: Any, request: Any) -> Any:
        given, _, rest = request.path.removeprefix("/").partition("/")
        name, mark, query = given.partition("?")
        response = answer(connection, request.headers, name)
        if response is None:
            request.path = f"/{rest}{mark}{query}"
            response = process(connection, request)
        return response

    return process_request


def _is_one_of(text: str, secrets_: list[str]) -> bool:
    return any(hmac.compare_digest(text.encode(), secret.encode()) for secret in secrets_)
