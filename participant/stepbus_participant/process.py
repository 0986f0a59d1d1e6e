"""The process of a participant, or its thread in a run in one process."""

import signal
import sys
from contextvars import ContextVar
from dataclasses import dataclass
from types import FrameType

from stepbus_schemas import RunError, StepbusError, WiringError

from .bus import Bus, BusError
from .bus.ticket import Ticket, load_ticket
from .bus.zenoh_bus import ZenohBus
from .session.session import Factory, Terminated, take_part


@dataclass(frozen=True)
class Host:
    """The place of one participant in a process that it shares with others.

    ticket: its identity. bus: what it takes instead of a connection to the ticket's endpoint.
    """

    ticket: Ticket
    bus: Bus


HOST: ContextVar[Host | None] = ContextVar("HOST", default=None)
"""Set by `stepbus run --in-process` where the program of a participant runs."""


WARNING = "warning: "
"""Begins a line of a participant's log that is shown to the user, and kept in `result.json`."""


def warn(text: str) -> None:
    """Write a warning to the participant's log: the user sees it at the end of the run."""
    sys.stderr.write(f"{WARNING}{text}\n")


def main(factory: Factory) -> int:
    """Join the run of this process's ticket and take part in it; return the exit code.

    factory: creates the participant from its configuration; usually its class. Exit code 0: the
    run ended; 1: this participant could not continue, see its log; 2: no ticket.
    """
    hosted = HOST.get()
    try:
        host = hosted or _own_process()
    except WiringError as exc:
        return _report(str(exc), 2)
    except BusError as exc:
        return _report(str(exc), 1)
    try:
        try:
            if hosted is None:
                signal.signal(signal.SIGTERM, _terminate)
            take_part(factory, host.ticket, host.bus)
        finally:
            _take_no_more_signals()
    except (StepbusError, KeyboardInterrupt) as exc:
        return _report(f"{host.ticket.name}: {_own_error(exc) or type(exc).__name__}", 1)
    finally:
        # A process with an open session and a callback hangs at its exit (P2.6).
        host.bus.close()
    return 0


def _own_process() -> Host:
    """Return the bus of this process's ticket; raises WiringError without one, BusError."""
    ticket = load_ticket()
    try:
        return Host(ticket, ZenohBus(ticket.endpoint, ticket.run))
    except BusError as exc:
        raise BusError(f"{ticket.name}: {exc}") from exc


def _terminate(_signal: int, _frame: FrameType | None) -> None:
    _take_no_more_signals()
    raise Terminated("ended by SIGTERM")


def _own_error(exc: BaseException) -> BaseException:
    """Return the error that a SIGTERM cut off on its way out of the participant, or `exc`."""
    cut_off = exc.__context__ if isinstance(exc, Terminated) else None
    while cut_off is not None and not isinstance(cut_off, RunError):
        cut_off = cut_off.__context__
    return cut_off or exc


def _take_no_more_signals() -> None:
    """From here on, a SIGTERM cuts off neither the closing nor the error that is being printed.

    The first SIGTERM calls it as well: a participant is interrupted once.
    """
    if signal.getsignal(signal.SIGTERM) is _terminate:
        signal.signal(signal.SIGTERM, _ignore)


def _ignore(_number: int, _frame: FrameType | None) -> None:
    """Do nothing; unlike SIG_IGN, programs that are started meanwhile do not inherit it."""


def _report(sentence: str, code: int) -> int:
    """Write one sentence to this process's log and return the exit code."""
    sys.stderr.write(sentence + "\n")
    return code
