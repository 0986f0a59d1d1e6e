"""Keys that control a run from the terminal: pause, resume, single steps, stop."""

import contextlib
import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Iterator

from stepbus_orchestrator.cli.terminal.output import has_screen
from stepbus_orchestrator.run.extensions.pace import Pace

HELP = "p or space: pause and resume · s or Enter: one step · q: stop"
_POLL_S = 0.2
_JOIN_S = 1.0


def has_terminal() -> bool:
    """Return whether a user can press keys and see their effect."""
    return sys.stdin.isatty() and has_screen(sys.stdout)


@contextlib.contextmanager
def controlled(pace: Pace, interrupt: threading.Event) -> Iterator[None]:
    """Read keys that control a run while this is open; do nothing without a terminal.

    interrupt: is set when the user stops the run.
    """
    if not has_terminal():
        yield
        return
    over = threading.Event()
    terminal = sys.stdin.fileno()

    def listen() -> None:
        # The terminal may be gone.
        with contextlib.suppress(OSError):
            while not over.is_set():
                if select.select([terminal], [], [], _POLL_S)[0]:
                    if not (keys := os.read(terminal, 64)):
                        return
                    for key in keys.decode(errors="ignore"):
                        press(key, pace, interrupt)

    before = termios.tcgetattr(terminal)
    tty.setcbreak(terminal)
    thread = threading.Thread(target=listen, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        # Another process that reads the terminal may have taken the key that it waits to read.
        thread.join(_JOIN_S)
        # Not TCSADRAIN, which waits for the reader; and the terminal may be gone.
        with contextlib.suppress(termios.error):
            termios.tcsetattr(terminal, termios.TCSANOW, before)


def press(key: str, pace: Pace, interrupt: threading.Event) -> None:
    """Do what a key stands for."""
    if key in "p ":
        (pace.resume if pace.paused else pace.pause)()
    elif key in "s\n\r":
        pace.step()
    elif key == "q":
        if pace.is_stopping:
            # A participant may hold the last step without a deadline.
            interrupt.set()
        pace.stop()
