"""The server behind a page: on loopback, for requests with its token, with our look."""

import asyncio
import contextlib
import html
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any
from urllib.parse import quote

from stepbus_participant import need
from stepbus_tools.theme import MARK, style_sheet
from stepbus_tools.viewing.access import (
    LOOPBACK,
    Process,
    address_of,
    listening,
    new_token,
    only_with,
)

_TITLE = "<title>Viser</title>"
_ICON = re.compile(r'<link\s+rel="icon".*?/>', re.DOTALL)
_PAGES = ("/", "/index.html")


def branded(page: str, title: str) -> str:
    """Return a page of viser's client with our title and mark."""
    icon = f'<link rel="icon" type="image/svg+xml" href="data:image/svg+xml,{quote(MARK)}"/>'
    page = _ICON.sub(lambda _: icon, page, count=1)
    return page.replace(_TITLE, f"<title>{html.escape(title)} · stepbus</title>", 1)


def with_front(process: Process, title: str) -> Process:
    """Return viser's request handler with our title, style and script in its page."""

    @cache
    def front(body: bytes) -> bytes:
        ours = f"<style>{style_sheet()}{_asset('front.css')}</style>"
        ours += f"<script>{_asset('front.js')}</script>"
        # Ahead of viser's own script, which reads what ours has set.
        return branded(body.decode(), title).replace("</title>", f"</title>{ours}", 1).encode()

    def process_request(connection: Any, request: Any) -> Any:
        # Else viser would compress the page.
        request.headers.pop("Accept-Encoding", None)
        response = process(connection, request)
        if response is not None and request.path.partition("?")[0] in _PAGES:
            response.body = front(response.body)
            del response.headers["Content-Length"]
            response.headers["Content-Length"] = str(len(response.body))
        return response

    return process_request


def _asset(name: str) -> str:
    return (files(__package__ or "") / "assets" / name).read_text("utf-8")


@dataclass(frozen=True, kw_only=True)
class Page:
    """An open page. server: of viser. address: URL with the secret that opens it."""

    server: Any
    address: str

    def close(self) -> None:
        """Close every connection, and the server."""
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

    token = new_token()
    # viser takes the next port when one is taken, and does not say what is wrong with a host.
    listening(host, port).close()
    # It waits for ever for a thread of its own that finds no free file descriptor.
    asyncio.new_event_loop().close()
    # It prints a box.
    with _guarded(token, label), contextlib.redirect_stdout(io.StringIO()):
        server = Server(host=host, port=port, verbose=False)
    server.gui.configure_theme(
        control_width="large",
        show_logo=False,
        show_share_button=False,
    )
    server.gui.set_panel_label(label)
    return Page(server=server, address=address_of(host, server.get_port(), token))


@contextlib.contextmanager
def _guarded(token: str, title: str) -> Iterator[None]:
    """Make a server that starts now refuse requests without the token.

    viser 1.1 has no option, hook or base class for that: it makes its own server, on a port that
    every user of the machine can connect to, so that no server of ours in front of it would help.
    But all of its requests pass `process_request` of websockets. title: of its page.
    """
    from websockets.asyncio import server as websockets  # noqa: PLC0415  (an extra)

    serve = websockets.serve

    def guarded(*args: Any, process_request: Process, **named: Any) -> Any:
        fronted = with_front(process_request, title)
        return serve(*args, process_request=only_with(token, fronted), **named)

    websockets.serve = guarded  # type: ignore[assignment,misc]  # for as long as it starts
    try:
        yield
    finally:
        websockets.serve = serve  # type: ignore[misc]
