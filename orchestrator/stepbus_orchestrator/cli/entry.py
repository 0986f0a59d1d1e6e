"""The process of the command `stepbus`: takes signals from its first moment to its last.

It loads little but the standard library by itself: the rest takes a second or more.
"""

import contextlib
import gc
import os
import signal
import sys
from collections.abc import Callable, Sequence

from stepbus_orchestrator.processes import PYTHON

from .interrupts import INTERRUPTED, SENTENCE, SIGNALS, interrupt, leave, on_signals

_IN_PROCESS, _WATCH = "--in-process", "--watch"
_INTERNAL = 1
_USAGE = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code (docs/exit-codes.md).

    arguments: default: those of this process, whose signals and streams it then takes.
    """
    if arguments is not None:
        return _execute(arguments)
    # What is loaded stays: to look for garbage in it takes a twentieth of a start.
    gc.disable()
    # A command needs no further thread for its few numbers; to start them takes longer.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    on_signals(leave)
    # The supervisor starts this program with them blocked.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    is_host = _IN_PROCESS in sys.argv[1:] or sys.argv[1:2] == ["verify"]
    if is_host and _WATCH not in sys.argv:
        # It hosts participants.
        from .supervisor import adopt, settle, supervise  # noqa: PLC0415  (see the top)

        if not adopt():
            return supervise(PYTHON)
        code = _run_command()
        settle(code)
    else:
        code = _run_command()
    # To look for garbage once more, as Python does at its end, takes longer than most here.
    # But libraries of participants (nanobind) print what they call leaks without it.
    gc.freeze()
    return code


def _execute(arguments: Sequence[str], loaded: Callable[[], None] = lambda: None) -> int:
    ends = (arguments.index(word) for word in ("--", "--exec") if word in arguments)
    own = arguments[: min(ends, default=None)]
    try:
        if not own or own[0].startswith(("-", "__")) or {"-h", "--help"} & {*own}:
            from .app import answer  # noqa: PLC0415  (see the top)

            answer(arguments)
        from stepbus_orchestrator.processes.warm import warm_parent  # noqa: PLC0415  (see the top)

        # From here on, it loads on a core of its own what participants need.
        is_forking = arguments[0] == "run" and not {_IN_PROCESS, _WATCH} & {*arguments}
        with warm_parent() if is_forking else contextlib.nullcontext():
            from .dispatch import execute  # noqa: PLC0415  (loads everything)

            return execute(arguments, loaded)
    except (ImportError, MemoryError) as exc:
        if isinstance(exc, MemoryError) or ".so" in str(exc):
            reason = str(exc) or "out of memory"
            sys.stderr.write(f"stepbus: {reason}; check the memory limit (ulimit -v)\n")
            return _INTERNAL
        from stepbus_participant import extra_hint, lacks  # noqa: PLC0415  (see the top)

        if not extra_hint(exc.name or ""):
            raise
        sys.stderr.write(f"stepbus: {lacks('the command line', str(exc.name))}\n")
        return _USAGE


def _run_command() -> int:
    """Run the command of this process, whatever becomes of its output; return its exit code."""
    from .terminal.stdout_buffer import buffered  # noqa: PLC0415  (see the top)

    with buffered() as (output, _):
        try:
            code = _execute(sys.argv[1:], _begin)
        except SystemExit as exc:
            code = exc.code if isinstance(exc.code, int) else 0
        except (KeyboardInterrupt, RuntimeError) as exc:
            # In a class that is being made, Python 3.11 wraps it.
            if not isinstance(exc.__cause__ or exc, KeyboardInterrupt):
                raise
            code = INTERRUPTED
            sys.stderr.write(SENTENCE)
        finally:
            on_signals(signal.SIG_IGN)
    return _INTERNAL if code == 0 and output.is_needed and output.failure else code


def _begin() -> None:
    """End with what the command has to clean up from now on, and look for garbage in the rest."""
    on_signals(interrupt)
    gc.freeze()
    gc.enable()
