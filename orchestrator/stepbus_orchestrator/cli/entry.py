"""The process of the command `stepbus`: takes signals from its first moment to its last.

It loads little but the standard library by itself: the rest takes a second or more.
"""

import gc
import os
import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType

from stepbus_orchestrator.cli import signals
from stepbus_orchestrator.processes import PYTHON

from .overview import answer
from .signals import SIGNALS, forget_swallowed, interrupt, on_signals, retry_swallowed

_IN_PROCESS = "--in-process"
_INTERNAL = 1
_USAGE = 2
_INTERRUPTED = 130
_SENTENCE = "stepbus: interrupted\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code (docs/exit-codes.md).

    arguments: default: those of this process, whose signals and streams it then takes.
    """
    if arguments is None:
        return _main()
    return _execute(arguments)


def _execute(arguments: Sequence[str], loaded: Callable[[], None] = lambda: None) -> int:
    answer(arguments)
    from .commands import execute  # noqa: PLC0415  (loads everything)

    return execute(arguments, loaded)


def _main() -> int:
    try:
        return _guarded()
    except (ImportError, MemoryError) as exc:
        if isinstance(exc, ImportError) and ".so" not in str(exc):
            return _lacking(exc)
        reason = str(exc) or "out of memory"
        sys.stderr.write(f"stepbus: {reason}; check the memory limit (ulimit -v)\n")
        return _INTERNAL


def _lacking(exc: ImportError) -> int:
    """Say which extra is missing; raise any other error of an import, which is ours."""
    from stepbus_participant import extra_hint, lacks  # noqa: PLC0415  (see the top)

    if not extra_hint(exc.name or ""):
        raise exc
    sys.stderr.write(f"stepbus: {lacks('the command line', str(exc.name))}\n")
    return _USAGE


def _guarded() -> int:
    # What is loaded stays: to look for garbage in it takes a twentieth of a start.
    gc.disable()
    # A command needs no further thread for its few numbers; to start them takes longer.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    on_signals(_leave)
    # Those that came while this program was replaced by itself, see `_set_environment`.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    retry_swallowed()
    is_hosted = _hosts_participants()
    if is_hosted:
        from .supervisor import adopt, supervise  # noqa: PLC0415  (see the top)

        if not adopt():
            return supervise(PYTHON)
    from stepbus_orchestrator.cli.terminal.stdout_buffer import buffered  # noqa: PLC0415

    with buffered() as output:
        code: int | None = None
        try:
            on_signals(interrupt)
            code = _execute(sys.argv[1:], _collect_garbage)
            signals.is_settled = True
        except SystemExit as exc:
            signals.is_settled = True
            code = exc.code if isinstance(exc.code, int) else 0
        except (KeyboardInterrupt, RuntimeError) as exc:
            if not _is_interrupt(exc):
                raise
            # An assignment lets no further signal in, as a call would.
            signals.is_settled = True
            if code is None:
                code = _INTERRUPTED
                sys.stderr.write(_SENTENCE)
        finally:
            signals.is_settled = True
            on_signals(signal.SIG_IGN)
            forget_swallowed()
            # To look for garbage once more, as Python does at its end, takes longer than most here.
            # But libraries of participants (nanobind) print what they call leaks without it.
            if not is_hosted:
                gc.freeze()
    if code == 0 and output.is_needed and output.is_incomplete:
        code = _INTERNAL
    if is_hosted:
        from .supervisor import settle  # noqa: PLC0415  (see the top)

        settle(code, is_mute=output.is_mute)
    return code


def _collect_garbage() -> None:
    """Look for garbage from now on, in what is not loaded yet."""
    gc.freeze()
    gc.enable()


def _is_interrupt(exc: BaseException) -> bool:
    """Return whether a signal raised it: in a class that is being made, Python wraps it."""
    return isinstance(exc, KeyboardInterrupt) or isinstance(exc.__cause__, KeyboardInterrupt)


def _hosts_participants() -> bool:
    """Return whether the command runs participants in its own process, and needs a supervisor."""
    return _IN_PROCESS in sys.argv[1:] or sys.argv[1:2] == ["verify"]


def _leave(_number: int, _frame: FrameType | None) -> None:
    """End at once: nothing has started that would have to end first."""
    try:
        os.write(2, _SENTENCE.encode())
    finally:
        os._exit(_INTERRUPTED)
