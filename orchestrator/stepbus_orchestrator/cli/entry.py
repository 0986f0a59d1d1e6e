"""The process of the command `stepbus`: takes signals from its first moment to its last.

It loads little but the standard library by itself: the rest takes a second or more.
"""

import os
import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any

from stepbus_orchestrator.processes.environment import PYTHON, is_set

_IN_PROCESS = "--in-process"
_INTERNAL = 1
_INTERRUPTED = 130
_SENTENCE = "stepbus: interrupted\n"
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, `kill`, and a terminal that is closed: each ends a command, with the same exit code."""

_RETRY_S = 0.01

_is_settled = False
"""Whether the exit code stands: from then on a signal changes nothing."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code (docs/exit-codes.md).

    arguments: default: those of this process, whose signals and streams it then takes.
    """
    if arguments is None:
        return _main()
    from .commands import execute  # noqa: PLC0415  (loads everything)

    return execute(arguments)


def _main() -> int:
    try:
        return _guarded()
    except (ImportError, MemoryError) as exc:
        if isinstance(exc, ImportError) and ".so" not in str(exc):
            raise
        reason = str(exc) or "out of memory"
        sys.stderr.write(f"stepbus: {reason}; does the limit of memory (ulimit -v) allow enough?\n")
        return _INTERNAL


def _guarded() -> int:
    global _is_settled  # noqa: PLW0603  (a signal handler has no other way to know)
    on_signals(_leave)
    # Those that came while this program was replaced by itself, see `_set_environment`.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
    _retry_swallowed_interrupts()
    if _IN_PROCESS in sys.argv[1:] or sys.argv[1:2] == ["verify"]:
        _set_environment()
    from .commands import execute  # noqa: PLC0415  (loads everything)
    from .terminal.outlet import outlets  # noqa: PLC0415

    with outlets():
        code: int | None = None
        try:
            on_signals(_interrupt)
            code = execute(sys.argv[1:])
            _is_settled = True
        except SystemExit as exc:
            _is_settled = True
            code = exc.code if isinstance(exc.code, int) else 0
        except KeyboardInterrupt:
            # An assignment lets no further signal in, as a call would.
            _is_settled = True
            if code is None:
                code = _INTERRUPTED
                sys.stderr.write(_SENTENCE)
        finally:
            _is_settled = True
            on_signals(signal.SIG_IGN)
            forget_swallowed()
    return code


def _set_environment() -> None:
    """Start anew with the environment of participants; Python and BLAS read it at their start."""
    if not is_set():
        # A program that is replaced has no handlers yet: signals wait until it has.
        signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
        again = [sys.executable, *sys.orig_argv[1:]]
        os.execve(sys.executable, again, {**os.environ, **PYTHON})  # noqa: S606  (it is this one)


def settle() -> None:
    """Keep the exit code of the command from now on, whatever signal comes."""
    global _is_settled  # noqa: PLW0603  (a signal handler has no other way to know)
    _is_settled = True


def on_signals(
    handler: Callable[[int, FrameType | None], None] | signal.Handlers,
) -> dict[int, Any]:
    """Handle the signals that end a command, and return their handlers before."""
    # `nohup` ignores SIGHUP on purpose.
    kept = {signal.SIGHUP} if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN else set()
    return {number: signal.signal(number, handler) for number in _SIGNALS if number not in kept}


def _leave(_number: int, _frame: FrameType | None) -> None:
    """End at once: nothing has started that would have to end first."""
    try:
        os.write(2, _SENTENCE.encode())
    finally:
        os._exit(_INTERRUPTED)


def _retry_swallowed_interrupts() -> None:
    """Raise an interrupt again where a destructor or a weak reference's callback swallowed it.

    Python prints a traceback there, and continues as if there had been no signal.
    """
    usual = sys.unraisablehook

    def hook(unraisable: "sys.UnraisableHookArgs") -> None:
        if unraisable.exc_type is not KeyboardInterrupt:
            usual(unraisable)
        elif not _is_settled:
            # Not at once: this hook is of no use for exceptions of its own.
            signal.setitimer(signal.ITIMER_REAL, _RETRY_S)

    signal.signal(signal.SIGALRM, _interrupt)
    sys.unraisablehook = hook


def forget_swallowed() -> None:
    """Raise no interrupt again: what it should have ended has ended."""
    signal.setitimer(signal.ITIMER_REAL, 0)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    if not _is_settled:
        raise KeyboardInterrupt
