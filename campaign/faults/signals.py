"""Signals to the participants, the orchestrator and the reaper."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import time
from collections.abc import Iterator

import psutil

from campaign.sandbox import Sandbox

from .fault import START_S, Missed, Strike, one_of


def to_participant(*numbers: int) -> Strike:
    """Return a strike that sends one of these signals to a participant."""

    def strike(box: Sandbox, chance: random.Random) -> None:
        name = chance.choice(box.notes["participants"])
        box.notes["hit"] = name
        box.wait_for(lambda: box.find(name), START_S)
        send(box.find(name), one_of(box, numbers))

    return strike


def to_orchestrator(*numbers: int) -> Strike:
    """Return a strike that sends one of these signals to the orchestrator."""

    def strike(box: Sandbox, _chance: random.Random) -> None:
        box.orchestrator.send_signal(one_of(box, numbers))

    return strike


def to_reaper(*numbers: int) -> Strike:
    """Return a strike that sends one of these signals to the reaper."""

    def strike(box: Sandbox, _chance: random.Random) -> None:
        if not box.wait_for(lambda: box.find("reaper"), START_S):
            raise Missed
        send(box.find("reaper"), one_of(box, numbers))

    return strike


def storm(*numbers: int) -> Strike:
    """Return a strike that sends the orchestrator up to six of these signals in half a second."""

    def strike(box: Sandbox, chance: random.Random) -> None:
        for _ in range(chance.randrange(1, 7)):
            box.orchestrator.send_signal(chance.choice(numbers))
            time.sleep(chance.uniform(0.0, 0.1))

    return strike


@contextlib.contextmanager
def stopped(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """Stop a process of ours while this is open; it has stopped, or ended, once it is."""
    process.send_signal(signal.SIGSTOP)
    with contextlib.suppress(ChildProcessError):
        os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WEXITED | os.WNOWAIT)
    try:
        yield
    finally:
        process.send_signal(signal.SIGCONT)


def pause(_box: Sandbox, _chance: random.Random) -> None:
    """Wait a second between two strikes."""
    time.sleep(1.0)


def send(process: psutil.Process | None, number: int) -> None:
    """Send a signal to a process, if it is still there."""
    if process is not None:
        with contextlib.suppress(psutil.Error):
            process.send_signal(number)
