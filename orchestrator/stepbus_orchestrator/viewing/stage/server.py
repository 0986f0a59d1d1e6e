"""The server behind a page: on loopback, and only for those who know its address."""

import contextlib
import hmac
import io
import secrets
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

from stepbus_participant import need
from stepbus_schemas import WiringError

LOOPBACK = "127.0.0.1"
_TOKEN_BYTES = 16
_starting = threading.Lock()

Process = Callable[[Any, Any], Any]
"""What websockets asks of every request: (connection, request) → a response, or None to go on."""


@dataclass(frozen=True, kw_only=True)
class Page:
    """An open page. server: of viser. address: with its token."""

    server: Any
    address: str

    def close(self) -> None:
        """Close every connection, and the server."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()


def open_page(label: str, *, host: str = LOOPBACK, port: int = 0) -> Page:
    """Open a page; port 0: any that is free.

    Its address has a token that nobody can guess: any other request is refused. Raises
    ExtraMissing without viser, and WiringError for a port that is taken.
    """
    (viser,) = need("the view", "viser")
    token = secrets.token_urlsafe(_TOKEN_BYTES)
    with _starting, _guarded(token), contextlib.redirect_stdout(io.StringIO()):
        # It prints a box, and takes the next port when one is taken.
        server = viser.ViserServer(host=host, port=port, verbose=False)
    if port and server.get_port() != port:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()
        raise WiringError(f"port {port} of {host} is taken; choose another --port, or none")
    _refuse_sharing(server)
    server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    server.gui.set_panel_label(label)
    shown = "localhost" if host == "0.0.0.0" else host  # noqa: S104  (not bound here)
    return Page(server=server, address=f"http://{shown}:{server.get_port()}/{token}/")


@contextlib.contextmanager
def _guarded(token: str) -> Iterator[None]:
    """Let a server that starts now refuse whoever does not know the token.

    viser has no such option, but all of its requests pass `process_request` of websockets. Its
    page opens its websocket at its own address, with the token.
    """
    from websockets.asyncio import server as websockets  # noqa: PLC0415  (an extra)

    serve = websockets.serve

    def guarded(*args: Any, process_request: Process, **named: Any) -> Any:
        return serve(*args, process_request=_only_with(token, process_request), **named)

    websockets.serve = guarded  # type: ignore[assignment,misc]  # for as long as it starts
    try:
        yield
    finally:
        websockets.serve = serve  # type: ignore[misc]


def _only_with(token: str, process: Process) -> Process:
    def process_request(connection: Any, request: Any) -> Any:
        given, _, rest = request.path.removeprefix("/").partition("/")
        name, mark, query = given.partition("?")
        if not hmac.compare_digest(name.encode(), token.encode()):
            return connection.respond(HTTPStatus.FORBIDDEN, "Open the address with its token.\n")
        request.path = f"/{rest}{mark}{query}"
        return process(connection, request)

    return process_request


def _refuse_sharing(server: Any) -> None:
    """Let no page ask for a tunnel to the internet, which viser offers."""
    from viser import _messages as messages  # noqa: PLC0415  (an extra)

    handlers = server._websock_server._incoming_handlers
    handlers.pop(messages.ShareUrlRequest, None)
