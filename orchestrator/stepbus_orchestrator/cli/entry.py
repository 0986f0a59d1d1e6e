"""The process of the command `stepbus`: takes signals from its first moment to its last.

It loads little but the standard library by itself: the rest takes a second or more.
"""

import errno
import gc
import os
import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType

from stepbus_orchestrator.processes import PYTHON

from .signals import SIGNALS, interrupt, on_signals

_IN_PROCESS = "--in-process"
_INTERNAL = 1
_USAGE = 2
_INTERRUPTED = 130
_SENTENCE = "stepbus: interrupted\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code (docs/exit-codes.md).

    arguments: default: those of this process, whose signals and streams it then takes.
    """
    if arguments is not None:
        return _execute(arguments)
    try:
        return _main()
    except (ImportError, MemoryError) as exc:
        if isinstance(exc, ImportError) and ".so" not in str(exc):
            return _report_missing(exc)
        reason = str(exc) or "out of memory"
        sys.stderr.write(f"stepbus: {reason}; check the memory limit (ulimit -v)\n")
        return _INTERNAL


def _execute(arguments: Sequence[str], loaded: Callable[[], None] = lambda: None) -> int:
    ends = (arguments.index(word) for word in ("--", "--exec") if word in arguments)
    own = arguments[: min(ends, default=None)]
    if not own or own[0].startswith(("-", "__")) or {"-h", "--help"} & {*own}:
        from .app import answer  # noqa: PLC0415  (see the top)

        answer(arguments)
    from .execute import execute  # noqa: PLC0415  (loads everything)

    return execute(arguments, loaded)


def _report_missing(exc: ImportError) -> int:
    """Say which extra is missing; raise any other error of an import, which is ours."""
    from stepbus_participant import extra_hint, lacks  # noqa: PLC0415  (see the top)

    if not extra_hint(exc.name or ""):
        raise exc
    sys.stderr.write(f"stepbus: {lacks('the command line', str(exc.name))}\n")
    return _USAGE


def _main() -> int:
    # What is loaded stays: to look for garbage in it takes a twentieth of a start.
    gc.disable()
    # A command needs no further thread for its few numbers; to start them takes longer.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    on_signals(_leave)
    # The supervisor starts this program with them blocked.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    if not (_IN_PROCESS in sys.argv[1:] or sys.argv[1:2] == ["verify"]):
        code, _ = _run_command()
        # To look for garbage once more, as Python does at its end, takes longer than most here.
        # But libraries of participants (nanobind) print what they call leaks without it.
        gc.freeze()
        return code
    # It hosts participants.
    from .supervisor import adopt, settle, supervise  # noqa: PLC0415  (see the top)

    if not adopt():
        return supervise(PYTHON)
    code, is_mute = _run_command()
    settle(code, is_mute=is_mute)
    return code


def _run_command() -> tuple[int, bool]:
    """Run the command of this process; return its exit code, and whether stderr was closed."""
    from .terminal.stdout_buffer import buffered  # noqa: PLC0415  (see the top)

    code: int | None = None
    with buffered() as (output, error):
        try:
            code = _execute(sys.argv[1:], _begin)
        except SystemExit as exc:
            code = exc.code if isinstance(exc.code, int) else 0
        except (KeyboardInterrupt, RuntimeError) as exc:
            # In a class that is being made, Python 3.11 wraps it.
            if not isinstance(exc.__cause__ or exc, KeyboardInterrupt):
                raise
            if code is None:
                code = _INTERRUPTED
                sys.stderr.write(_SENTENCE)
        finally:
            on_signals(signal.SIG_IGN)
    is_lost = code == 0 and output.is_needed and output.is_incomplete
    return _INTERNAL if is_lost else code, error.failure == errno.EBADF


def _begin() -> None:
    """End with what the command has to clean up from now on, and look for garbage in the rest."""
    on_signals(interrupt)
    gc.freeze()
    gc.enable()


def _leave(_number: int, _frame: FrameType | None) -> None:
    """End at once: nothing has started that would have to end first."""
    try:
        os.write(2, _SENTENCE.encode())
    finally:
        os._exit(_INTERRUPTED)
