"""Ctrl-C, SIGTERM and SIGHUP end a run cleanly."""

import contextlib
import signal
import threading
from collections.abc import Iterator, Mapping
from types import FrameType
from typing import Any

from stepbus_orchestrator.cli.signals import forget_swallowed, on_signals


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
    """Let the first such signal raise KeyboardInterrupt; the others do what they did before."""
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
