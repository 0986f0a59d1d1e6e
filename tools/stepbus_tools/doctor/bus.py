"""The bus: a message has to arrive over each transport."""

import tempfile
import time
from contextlib import closing
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Literal

from stepbus_orchestrator.processes.credentials import certificates, passwords
from stepbus_participant import BusError, Endpoint, ZenohBus
from stepbus_tools.doctor.machine import Finding, free_ports

_DEADLINE_S = 5.0
_AGAIN_S = 0.01


def link(transport: Literal["unix", "tcp"]) -> Finding:
    """Pass a message between two sessions, linked as those of a run are."""
    what = f"bus, {transport}"
    try:
        with tempfile.TemporaryDirectory(prefix="stepbus-") as folder:
            took_s = _pass_message(*_endpoints(transport, folder))
    except (BusError, Empty, OSError) as exc:
        reason = str(exc) or f"silence for {_DEADLINE_S:g} s; does a firewall cut loopback?"
        return Finding(what=what, verdict="fail", text=f"no message came through: {reason}")
    text = f"a message came through {took_s:.2f} s after start"
    return Finding(what=what, verdict="ok", text=text)


def _endpoints(transport: str, folder: str) -> tuple[Endpoint, Endpoint]:
    if transport == "unix":
        one, other = (f"unixsock-stream/{folder}/{index}.sock" for index in range(2))
        settings: dict[str, dict[str, Any]] = {"one": {}, "other": {}}
    else:
        one, other = (f"tls/127.0.0.1:{port}" for port in free_ports(2))
        settings = certificates(("one", "other"), Path(folder))
    users = passwords(("one", "other"))
    return (
        Endpoint(
            listen=[one], connect=[], user="one", password=users["one"], users=users,
            settings=settings["one"],
        ),
        Endpoint(
            listen=[other], connect=[one], user="other", password=users["other"], users=users,
            settings=settings["other"],
        ),
    )  # fmt: skip


def _pass_message(one: Endpoint, other: Endpoint) -> float:
    """Return how long it took from the first session to the message [s]."""
    began = time.monotonic()
    inbox: SimpleQueue[Any] = SimpleQueue()
    with closing(ZenohBus(one, "doctor")) as sender, closing(ZenohBus(other, "doctor")) as receiver:
        receiver.subscribe("hello", inbox.put)
        put = sender.publisher("hello", "text/plain")
        while time.monotonic() - began < _DEADLINE_S:
            put(b"hello")
            try:
                inbox.get(timeout=_AGAIN_S)
            except Empty:
                continue
            return time.monotonic() - began
    raise Empty
