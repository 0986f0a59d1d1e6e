"""The server behind a page: on loopback, and only for browsers that its door has let in."""

import contextlib
import io
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from stepbus_participant import need
from stepbus_schemas import WiringError
from stepbus_tools.viewing.access import LOOPBACK, Door, Process, listening

from .front import with_front

_starting = threading.Lock()


@dataclass(frozen=True, kw_only=True)
class Page:
    """An open page. server: of viser. address: opens it once."""

    server: Any
    door: Door
    address: str

    def new_address(self) -> str:
        """Return another address that opens it once."""
        return self.door.new_address()

    def close(self) -> None:
        """Close every connection, and the server."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()


def open_page(
    label: str,
    *,
    host: str = LOOPBACK,
    port: int = 0,
    tell: Callable[[str], None] = lambda _address: None,
) -> Page:
    """Open a page; port 0: any that is free.

    Its address has a token that cannot be guessed and that works once, for one browser: any other
    request is refused. tell: gets another address where one is used again. Raises
    ExtraMissing without viser, and WiringError for a port that is taken, or a host that is not of
    this machine.
    """
    (viser,) = need("the view", "viser")

    class Server(viser.ViserServer):  # type: ignore[misc,name-defined]  # of an extra
        def request_share_url(self, verbose: bool = True) -> str | None:
            """Refuse the tunnel to the internet that any browser may ask viser for."""

    door = Door(host, tell)
    # viser takes the next port when one is taken, and does not say what is wrong with a host.
    listening(host, port).close()
    # It prints a box.
    with _starting, _guarded(door, label), contextlib.redirect_stdout(io.StringIO()):
        server = Server(host=host, port=port, verbose=False)
    door.port = server.get_port()
    page = Page(server=server, door=door, address=door.new_address())
    if port and door.port != port:
        page.close()
        raise WiringError(
            f"port {port} of {host} is in use; choose another --port, or omit it for a free one"
        )
    server.gui.configure_theme(
        control_width="large",
        show_logo=False,
        show_share_button=False,
    )
    server.gui.set_panel_label(label)
    return page


@contextlib.contextmanager
def _guarded(door: Door, title: str) -> Iterator[None]:
    """Make a server that starts now refuse requests that do not come through the door.

    viser 1.1 has no option, hook or base class for that: it makes its own server, on a port that
    every user of the machine can connect to, so that no server of ours in front of it would help.
    But all of its requests pass `process_request` of websockets. title: of its page.
    """
    from websockets.asyncio import server as websockets  # noqa: PLC0415  (an extra)

    serve = websockets.serve

    def guarded(*args: Any, process_request: Process, **named: Any) -> Any:
        fronted = with_front(process_request, title)
        return serve(*args, process_request=door.guard(fronted), **named)

    websockets.serve = guarded  # type: ignore[assignment,misc]  # for as long as it starts
    try:
        yield
    finally:
        websockets.serve = serve  # type: ignore[misc]
