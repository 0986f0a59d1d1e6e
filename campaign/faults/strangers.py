"""Strangers on the sockets and ports of a run."""

from __future__ import annotations

import contextlib
import random
import select
import subprocess
import sys
from pathlib import Path

import psutil

from campaign.sandbox import Sandbox

from .fault import START_S, Missed, Strike, one_of

_PROGRAM = Path(__file__).with_name("stranger.py")
_READY_S = 30.0


def deed(*names: str, nobody: bool = False) -> Strike:
    """Return a strike that does one of these deeds on all sockets and ports of the run."""

    def strike(box: Sandbox, _chance: random.Random) -> None:
        box.wait_for(lambda: addresses(box), START_S)
        reached = addresses(box)
        if reached:
            _start(box, one_of(box, names), reached, nobody=nobody)

    return strike


def with_tickets(box: Sandbox, _chance: random.Random) -> None:
    """Subscribe with stolen credentials, then stop reading."""
    box.wait_for(lambda: _tickets(box), START_S)
    if _tickets(box):
        _start(box, "subscribe_stolen", _tickets(box))


def as_caller(box: Sandbox, _chance: random.Random) -> None:
    """Call the run with nonsense, then stop reading."""
    box.wait_for((box.out / ".live.json").exists, START_S)
    _start(box, "call", [str(box.out)])


def _tickets(box: Sandbox) -> list[str]:
    return [str(path) for path in box.temporary.glob("stepbus-*/*.ticket")]


def _start(box: Sandbox, name: str, words: list[str], *, nobody: bool = False) -> None:
    helper = subprocess.Popen(
        [sys.executable, str(_PROGRAM), *(["--nobody"] if nobody else []), name, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    box.helpers.append(helper)
    if helper.stdout is not None:
        select.select([helper.stdout], [], [], _READY_S)
    if box.orchestrator.poll() == 0:
        raise Missed


def addresses(box: Sandbox) -> list[str]:
    """Return where the processes of a run listen."""
    paths = sorted(box.temporary.glob("stepbus-*/*.sock"))
    return [f"unixsock-stream/{path}" for path in paths] + [
        f"tcp/127.0.0.1:{port}" for port in sorted(_ports(box))
    ]


def _ports(box: Sandbox) -> set[int]:
    ports = set()
    for process in box.processes():
        with contextlib.suppress(psutil.Error):
            for link in process.net_connections("tcp"):
                if link.status == psutil.CONN_LISTEN:
                    ports.add(link.laddr.port)
    return ports
