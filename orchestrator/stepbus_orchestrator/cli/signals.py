"""The signals that end a command, and when they no longer do."""

import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, `kill`, and a terminal that is closed: each ends a command, with the same exit code."""

_RETRY_S = 0.01

is_settled = False
"""Whether the exit code stands: from then on a signal changes nothing."""


def settle() -> None:
    """Keep the exit code of the command from now on, whatever signal comes."""
    global is_settled  # noqa: PLW0603  (a signal handler has no other way to know)
    is_settled = True


def on_signals(
    handler: Callable[[int, FrameType | None], None] | signal.Handlers,
) -> dict[int, Any]:
    """Handle the signals that end a command, and return their handlers before."""
    # `nohup` ignores SIGHUP on purpose.
    kept = {signal.SIGHUP} if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN else set()
    return {number: signal.signal(number, handler) for number in SIGNALS if number not in kept}


def interrupt(_number: int, _frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, unless the exit code stands."""
    if not is_settled:
        raise KeyboardInterrupt


def retry_swallowed() -> None:
    """Raise an interrupt again where a destructor or a weak reference's callback swallowed it.

    Python prints a traceback there, and continues as if there had been no signal.
    """
    default = sys.unraisablehook

    def hook(unraisable: "sys.UnraisableHookArgs") -> None:
        if unraisable.exc_type is not KeyboardInterrupt:
            default(unraisable)
        elif not is_settled:
            # Not at once: this hook is of no use for exceptions of its own.
            signal.setitimer(signal.ITIMER_REAL, _RETRY_S)

    signal.signal(signal.SIGALRM, interrupt)
    sys.unraisablehook = hook


def forget_swallowed() -> None:
    """Raise no interrupt again: what it should have ended has ended."""
    signal.setitimer(signal.ITIMER_REAL, 0)


@contextlib.contextmanager
def interruptible() -> Iterator[threading.Event]:
    """Yield an event that such a signal sets; for `run`, which then ends cleanly."""
    interrupt = threading.Event()
    before = on_signals(lambda _number, _frame: interrupt.set())
    try:
        yield interrupt
    finally:
        _restore(before)


@contextlib.contextmanager
def abortable() -> Iterator[None]:
    """Raise KeyboardInterrupt at the first such signal; the others do what they did before."""
    before: dict[int, Any] = {}

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        _restore(before)
        raise KeyboardInterrupt

    before |= on_signals(on_signal)
    try:
        yield
    finally:
        forget_swallowed()
        _restore(before)


def _restore(handlers: Mapping[int, Any]) -> None:
    for number, handler in handlers.items():
        signal.signal(number, handler)
