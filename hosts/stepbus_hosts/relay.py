"""The gateway of a run, as a process: all other hosts reach this one, and nothing else.

`python -m stepbus_hosts.relay` reads an `Order`, a line of JSON, from its standard input, and `cut
NAME` for each participant whose link is to end; when that closes, it ends. Its standard error tells
each link that opens and closes, and which are silent, a line of JSON each. Its standard output is
Zenoh's log, in which refused connections and messages are told: Zenoh tells its program nothing.

Zenoh routes what participants publish on its own threads. No Python is between them.
"""

import contextlib
import json
import os
import select
import socket
import sys
from collections.abc import Iterator
from typing import Any

import msgspec

from stepbus_participant import BusError, Endpoint, ZenohBus
from stepbus_participant.bus.links import sockets, tcp_links, tune

_LOOK_S = 0.5
_TCP_INFO_BYTES = 104
_RETRANSMITS, _LAST_ACKED = 2, 8 + 4 * 12
"""Places in the kernel's `struct tcp_info`: how often the oldest segment has been repeated, and how
long nothing was acknowledged [ms]."""


class Order(msgspec.Struct):
    """What a relay has to know. run: names the key space."""

    endpoint: Endpoint
    run: str


def _tell(**row: Any) -> None:
    # In one piece: Zenoh's thread tells of links, ours of silence.
    with contextlib.suppress(BrokenPipeError):
        os.write(2, f"{json.dumps(row)}\n".encode())


def _port() -> int:
    """Return the port on which Zenoh listens."""
    option = socket.SOL_SOCKET, socket.SO_ACCEPTCONN
    tcp = (found for found in sockets() if found.family == socket.AF_INET)
    return next(int(found.getsockname()[1]) for found in tcp if found.getsockopt(*option))


class _Links:
    """The links that participants have opened. names: address of the other end → participant."""

    def __init__(self) -> None:
        self.names: dict[str, str] = {}
        self._told: dict[str, int] = {}

    def changed(self, event: Any) -> None:
        """Take a link that has opened or closed; the gateway's own ones have no certificate."""
        name, address = event.link.auth_identifier, str(event.link.dst).removeprefix("tls/")
        if name is None:
            return
        is_open = "PUT" in str(event.kind)
        if is_open:
            self.names[address] = name
        else:
            self.names.pop(address, None)
        _tell(**{"linked" if is_open else "closed": name, "address": address})

    def _open(self) -> Iterator[tuple[str, socket.socket]]:
        for address, link in tcp_links():
            if address in self.names:
                yield self.names[address], link

    def cut(self, name: str) -> None:
        """End the links of a participant, under Zenoh."""
        for owner, link in self._open():
            if owner == name:
                with contextlib.suppress(OSError):
                    link.shutdown(socket.SHUT_RDWR)

    def look(self) -> None:
        """Tell of each link for how long its other end is silent [ms]; tune those that are new."""
        silent = {}
        for name, link in self._open():
            info = link.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _TCP_INFO_BYTES)
            acked_ms = int.from_bytes(info[_LAST_ACKED : _LAST_ACKED + 4], sys.byteorder)
            silent[name] = acked_ms if info[_RETRANSMITS] else 0
            if name not in self._told:
                self._told[name] = 0
                tune(link)
        if any(silent.values()) or any(self._told.values()):
            _tell(silent_ms=silent)
        self._told = {name: silent.get(name, 0) for name in self._told}


def main() -> None:
    """Relay until the orchestrator closes our standard input."""
    import zenoh  # noqa: PLC0415  (its log has to be set up before a session)

    # Unbuffered: what follows is waited for.
    with open(0, "rb", buffering=0, closefd=False) as stdin:
        order = msgspec.json.decode(stdin.readline(), type=Order)
    zenoh.init_log_from_env_or("error")
    try:
        bus = ZenohBus(order.endpoint, order.run)
    except BusError as exc:
        _tell(failed=str(exc))
        return
    links = _Links()
    listener = bus.session.info.declare_link_events_listener(links.changed, history=True)
    _tell(port=_port())
    try:
        while True:
            ready, _, _ = select.select([0], [], [], _LOOK_S)
            if ready:
                line = os.read(0, 4096)
                if not line:
                    break
                for name in line.decode().replace("cut ", "").split():
                    links.cut(name)
            links.look()
    finally:
        listener.undeclare()
        bus.close()


if __name__ == "__main__":
    main()
