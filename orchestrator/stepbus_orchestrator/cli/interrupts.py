"""The signals that end a command: Ctrl-C, `kill`, and a terminal that is closed."""

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""All end a command with the same exit code."""
INTERRUPTED = 130
SENTENCE = "stepbus: interrupted\n"


def on_signals(
    handler: Callable[[int, FrameType | None], None] | signal.Handlers,
) -> dict[int, Any]:
    """Handle the signals that end a command; return signal → previous handler."""
    # `nohup` ignores SIGHUP on purpose.
    kept = {signal.SIGHUP} if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN else set()
    return {number: signal.signal(number, handler) for number in SIGNALS if number not in kept}


def leave(_number: int, _frame: FrameType | None) -> None:
    """End at once: nothing has started that would have to end first."""
    try:
        os.write(2, SENTENCE.encode())
    finally:
        os._exit(INTERRUPTED)


def interrupt(_number: int, _frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt."""
    raise KeyboardInterrupt


@contextlib.contextmanager
def interrupting() -> Iterator[None]:
    """Let the signals raise KeyboardInterrupt while this is open."""
    before = on_signals(interrupt)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def interruptible(*, ends: bool = False) -> Iterator[threading.Event]:
    """Yield an event that the signals set while this is open, so that a run ends cleanly.

    ends: the exit code of the command is settled in this block: signals after it change nothing.
    """
    event = threading.Event()
    before = on_signals(lambda _number, _frame: event.set())
    try:
        yield event
    finally:
        for number, handler in before.items():
            if not (ends and handler is interrupt):
                signal.signal(number, handler)
