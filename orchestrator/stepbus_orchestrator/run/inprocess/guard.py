"""Keeps what a participant does to its process from the others, which share it.

Python tells audit hooks of forks, signals and programs before they happen; of threads, 3.11 does
not, nor of descriptors that are closed. A fork is refused: its child would be a second
orchestrator, with the same open files; but for a copy that closes these and never comes back
(`stepbus_participant.copies`).
"""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import wraps
from typing import Any, Protocol

from stepbus_participant.copies import makes_copy

_CAUGHT = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""A process of a participant's own ends by these."""
_STOPS = (signal.SIGSTOP, signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
_HARMLESS = (0, signal.SIGCHLD, signal.SIGCONT, signal.SIGURG, signal.SIGWINCH)


class Ended(BaseException):
    """What ends a participant whose process would get a signal; `number` is that signal."""

    def __init__(self, number: int) -> None:
        super().__init__(f"ended by {signal.Signals(number).name}")
        self.number = number


class Guarded(Protocol):
    """A participant whose code is watched."""

    @property
    def name(self) -> str:
        """Return its name."""

    def before_program(self) -> None:
        """Take note that it is about to start a program."""

    def starting(self, thread: threading.Thread) -> AbstractContextManager[None]:
        """Take note that it starts a thread, in a block."""


Owner = Callable[[], Guarded | None]
"""Returns whose code runs on this thread; None: that of no participant."""

_open: list[Owner] = []
"""Of the runs that are watched."""
_hooked: list[Callable[..., None]] = []
"""The audit hook, once there is one: it stays for good, as do the other ways to start
threads and to close descriptors. They do nothing while no run is open."""


def guard(owner: Owner) -> None:
    """Watch the code of the participants of a run from now on."""
    if not _hooked:
        _hooked.append(_audit)
        sys.addaudithook(_audit)
        # Not assigned: that mypy refuses for a method.
        setattr(threading.Thread, "start", _noted(threading.Thread.start))  # noqa: B010
        setattr(os, "closerange", _kept(os.closerange))  # noqa: B010
    _open.append(owner)


def unguard(owner: Owner) -> None:
    """Watch it no more."""
    _open.remove(owner)


def _audit(event: str, arguments: tuple[Any, ...]) -> None:
    act = _ACTS.get(event)
    if act is not None and (guarded := _guarded()) is not None:
        act(guarded, *arguments)


def _noted(start: Callable[[threading.Thread], None]) -> Callable[[threading.Thread], None]:
    """Return what starts a thread, and lets the participant know whose code does so."""

    @wraps(start)
    def started(thread: threading.Thread) -> None:
        guarded = _guarded()
        with contextlib.nullcontext() if guarded is None else guarded.starting(thread):
            start(thread)

    return started


def _kept(close: Callable[[int, int], None]) -> Callable[[int, int], None]:
    """Return what closes a range of descriptors, but for a participant: they are not its own."""

    @wraps(close)
    def closed(low: int, high: int, /) -> None:
        if (guarded := _guarded()) is not None:
            raise RuntimeError(
                f"{guarded.name} closes descriptors of the process that it shares with the "
                "orchestrator and all other participants; omit --in-process"
            )
        close(low, high)

    return closed


def _guarded() -> Guarded | None:
    """Return whose code runs on this thread."""
    found = (owner() for owner in tuple(_open))
    return next((guarded for guarded in found if guarded is not None), None)


def _on_fork(guarded: Guarded) -> None:
    if makes_copy():
        return
    raise RuntimeError(
        f"{guarded.name} forks the process that it shares with the orchestrator and all "
        "other participants; omit --in-process, or use `subprocess` or "
        "multiprocessing.get_context('spawn')"
    )


def _on_kill(guarded: Guarded, target: int, number: int) -> None:
    if target in {os.getpid(), 0, -os.getpgid(0)}:
        _end(guarded, number)


def _on_kill_group(guarded: Guarded, group: int, number: int) -> None:
    if group in {os.getpgid(0), 0}:
        _end(guarded, number)


def _end(guarded: Guarded, number: int) -> None:
    """End the participant alone by a signal that it sends to its process."""
    if number in _STOPS:
        raise RuntimeError(
            f"{guarded.name} stops the process that it shares with the orchestrator and "
            "all other participants; omit --in-process"
        )
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    if number in _HARMLESS:
        return
    if number in _CAUGHT or signal.getsignal(number) == signal.SIG_DFL:
        raise Ended(number)


def _on_program(guarded: Guarded, *_: object) -> None:
    guarded.before_program()


_ACTS: dict[str, Callable[..., None]] = {
    "os.fork": _on_fork,
    "os.forkpty": _on_fork,
    "os.kill": _on_kill,
    "os.killpg": _on_kill_group,
    "subprocess.Popen": _on_program,
    "os.posix_spawn": _on_program,
}
