"""The process of a participant: from its ticket to its exit code."""

import signal
import sys
from collections.abc import Callable, Mapping
from types import FrameType

from stepbus_participant.bus import Bus, BusError, ZenohBus
from stepbus_participant.bus.ticket import Ticket, load_ticket
from stepbus_participant.config import Config
from stepbus_participant.participant import Participant, PortType
from stepbus_participant.session import Session, Terminated, join
from stepbus_schemas import Message, RunError, StepbusError, Types, WiringError, type_name

from .hosting import HOST, Host

Factory = Callable[[Config], Participant]


def main(factory: Factory) -> int:
    """Take part in the run of this process's ticket; return the exit code.

    factory: makes the participant from its configuration; usually its class. Exit code 0: the
    run ended; 1: this participant could not continue, its log says why; 2: there is no ticket.
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


def take_part(factory: Factory, ticket: Ticket, bus: Bus) -> None:
    """Join a run over a bus, and step until it ends.

    Raises StepbusError when this participant cannot continue; the orchestrator knows why.
    """
    bus.declare_alive(f"alive/{ticket.name}")
    inputs, outputs = (_declared(factory, side) for side in ("inputs", "outputs"))
    types = Types.of(_classes(factory))
    welcome = join(bus, ticket, inputs, outputs, types)
    session = Session(
        factory,
        welcome,
        bus,
        types,
        faults=ticket.faults,
        profile=ticket.profile,
        checkpoint=ticket.checkpoint,
    )
    session.work()


def _declared(factory: Factory, side: str) -> dict[str, str] | None:
    """Return the ports that a participant's class requires, by type name; None: any."""
    ports: Mapping[str, PortType] | None = getattr(factory, side, None)
    if ports is None:
        return None
    return {
        port: type_name(item) if isinstance(item, type) else item for port, item in ports.items()
    }


def _classes(factory: Factory) -> list[type[Message]]:
    """Return the message classes that a participant's class requires."""
    sides = [getattr(factory, side, None) or {} for side in ("inputs", "outputs")]
    return [item for ports in sides for item in ports.values() if isinstance(item, type)]


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
