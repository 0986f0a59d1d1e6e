"""The door of a page: a server of ours before viser's, for requests with a secret in their path.

viser 1.1 has no option, hook or base class for a check of requests, and its port is open to every
user of the machine. So it closes each connection whose path does not begin with the secret, which
only those have that come through the door. What else it serves is its own page, without any data.
"""

import asyncio
import atexit
import contextlib
import errno
import hmac
import html
import io
import re
import secrets
import shutil
import socket
import tempfile
import threading
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from importlib.resources import files
from pathlib import Path
from socketserver import ThreadingTCPServer
from typing import Any
from urllib.parse import quote

from stepbus_participant import need, write_file
from stepbus_schemas import WiringError
from stepbus_tools.theme import MARK, style_sheet

LOOPBACK = "127.0.0.1"
_TOKEN_BYTES = 16
_PIECE_BYTES = 65536
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
_TITLE = "<title>Viser</title>"
_ICON = re.compile(r'<link\s+rel="icon".*?/>', re.DOTALL)


@dataclass(frozen=True, kw_only=True)
class Page:
    """An open page. server: of viser. address: URL with the secret that opens it."""

    server: Any
    address: str
    door: ThreadingTCPServer

    def close(self) -> None:
        """Close every connection, and both servers."""
        self.door.shutdown()
        self.door.server_close()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()


def open_page(label: str, *, host: str = LOOPBACK, port: int = 0) -> Page:
    """Open a page; port 0: any that is free.

    Its address has a secret; any request without it is refused. Raises ExtraMissing without viser,
    and WiringError for a port that is taken, or a host that is not of this machine.
    """
    (viser,) = need("the view", "viser")

    class Server(viser.ViserServer):  # type: ignore[misc,name-defined]  # of an extra
        def request_share_url(self, verbose: bool = True) -> str | None:
            """Refuse the tunnel to the internet that any browser may ask viser for."""

    token = secrets.token_urlsafe(_TOKEN_BYTES)
    door = _listening(host, port)
    # viser waits for ever for a thread of its own that finds no free file descriptor.
    asyncio.new_event_loop().close()
    # It prints a box.
    with contextlib.redirect_stdout(io.StringIO()):
        server = Server(host=LOOPBACK, port=0, label=label, verbose=False)
    _refuse_strangers(server, token)
    server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    door.token, door.viser_port = token, server.get_port()
    door.page = _front((files("viser") / "client/build/index.html").read_text("utf-8"), label)
    threading.Thread(target=door.serve_forever, name="door", daemon=True).start()
    shown = "localhost" if host in _ALL else f"[{host}]" if ":" in host else host
    address = f"http://{shown}:{door.server_address[1]}/{token}/"
    return Page(server=server, address=address, door=door)


def _refuse_strangers(server: Any, token: str) -> None:
    """Make viser close connections that have not come through the door."""
    from websockets.exceptions import ConnectionClosed  # noqa: PLC0415  (an extra)

    inner = server._websock_server

    async def check(visitor: Any) -> None:
        connection = inner._live_connections[visitor.client_id]
        if not _has(token, connection.request.path):
            await connection.close()
            with contextlib.suppress(ConnectionClosed):
                while True:
                    # What it has sent already takes no effect.
                    await connection.recv()

    inner.on_client_connect(check)
    # Those who were faster have seen an empty page, and come again.
    inner.disconnect_all_clients()


def _has(token: str, path: str) -> bool:
    """Return whether the path of a request begins with a secret."""
    given = path.partition("?")[0].removeprefix("/").partition("/")[0]
    return hmac.compare_digest(given.encode(), token.encode())


class _Door(ThreadingTCPServer):
    """Answers with the page, and passes WebSockets on to viser."""

    allow_reuse_address = daemon_threads = True
    token: str
    page: bytes
    viser_port: int

    def __init__(self, family: socket.AddressFamily, place: Any) -> None:
        self.address_family = family
        super().__init__(place, _Visit)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Leave out what goes wrong with a visitor that is gone."""


def _listening(host: str, port: int) -> _Door:
    """Return a door that listens; raises WiringError where it cannot."""
    try:
        family, _, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        return _Door(family, place)
    except OSError as exc:
        if exc.errno == errno.EADDRINUSE:
            why = f"port {port} of {host} is in use; choose another, or omit it for a free one"
            raise WiringError(why) from exc
        why = exc.strerror or str(exc)
        raise WiringError(f"cannot listen on {host}, port {port}: {why}") from exc


class _Visit(BaseHTTPRequestHandler):
    """A request, which needs the secret, from a page of this server."""

    server: _Door

    def do_GET(self) -> None:
        """Answer it, or refuse it."""
        host, origins = self.headers.get("Host"), self.headers.get_all("Origin", ())
        if not _has(self.server.token, self.path):
            self._answer(HTTPStatus.FORBIDDEN, b"Open the URL that `stepbus view` prints.\n")
        elif not all(origin in {f"http://{host}", f"https://{host}"} for origin in origins):
            why = b"A page of another server asks for this one.\n"
            self._answer(HTTPStatus.FORBIDDEN, why)
        elif self.headers.get("Upgrade") == "websocket":
            self._pass_on()
        elif self.path.partition("?")[0] == f"/{self.server.token}/":
            self._answer(HTTPStatus.OK, self.server.page, "text/html; charset=utf-8")
        else:
            self._answer(HTTPStatus.NOT_FOUND, b"There is one page only.\n")

    def log_message(self, *_: Any) -> None:
        """Print nothing."""

    def _answer(self, status: HTTPStatus, body: bytes, form: str = "text/plain") -> None:
        self.send_response(status)
        about = {"Content-Type": form, "Content-Length": str(len(body)), **_HEADERS}
        for name, value in about.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def _pass_on(self) -> None:
        """Let viser answer, and pass on what both say until one of them ends."""
        head = "".join(f"{name}: {value}\r\n" for name, value in self.headers.items())
        with socket.create_connection((LOOPBACK, self.server.viser_port)) as viser:
            viser.sendall(f"{self.requestline}\r\n{head}\r\n".encode("latin-1"))
            back = (viser.recv, self.connection.sendall, self.connection)
            threading.Thread(target=_copy, args=back, daemon=True).start()
            _copy(self.rfile.read1, viser.sendall, viser)


def _copy(
    read: Callable[[int], bytes], write: Callable[[bytes], object], end: socket.socket
) -> None:
    """Copy until there is no more; then tell the other end."""
    with contextlib.suppress(OSError):
        while data := read(_PIECE_BYTES):
            write(data)
        end.shutdown(socket.SHUT_RDWR)


def branded(page: str, title: str) -> str:
    """Return a page of viser's client with our title and mark."""
    icon = f'<link rel="icon" type="image/svg+xml" href="data:image/svg+xml,{quote(MARK)}"/>'
    page = _ICON.sub(lambda _: icon, page, count=1)
    return page.replace(_TITLE, f"<title>{html.escape(title)} · stepbus</title>", 1)


def _front(page: str, title: str) -> bytes:
    """Return viser's page with our title, style and script, which its own script reads."""
    ours = f"<style>{style_sheet()}{_asset('front.css')}</style>"
    ours += f"<script>{_asset('front.js')}</script>"
    return branded(page, title).replace("</title>", f"</title>{ours}", 1).encode()


def _asset(name: str) -> str:
    return (files(__package__ or "") / "stage" / "assets" / name).read_text("utf-8")


def open_in_browser(address: str) -> None:
    """Open an address with a secret in the browser, whose command line every user can read.

    So it gets the path of a file that leads there, which only this user can read.
    """
    folder = Path(tempfile.mkdtemp(prefix="stepbus-view-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    file = folder / "open.html"
    write_file(file, _REDIRECT.format(address=html.escape(address)).encode(), 0o600)
    webbrowser.open(file.as_uri())
