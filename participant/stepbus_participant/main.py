"""Take part in a run, from a ticket to the last step, and end cleanly on every path."""

from __future__ import annotations

import signal
import sys
import traceback
from collections.abc import Callable, Mapping
from types import FrameType

from stepbus_schemas import (
    Fault,
    Ready,
    RunError,
    StepbusError,
    Welcome,
    WiringError,
    encode,
    encoding_of,
    type_name,
)

from .bus import Bus, BusError
from .calls import Answers
from .config import Config
from .control import Control, OrchestratorLost, Stopped
from .faults import FaultyBus
from .inputs import PeerFault, make_inputs, make_sources
from .joining import become_ready, join
from .loop import StepLoop
from .outbox import Outbox, OutputError
from .participant import Participant, PortType
from .ticket import Ticket, load_ticket
from .zenoh_bus import ZenohBus

Factory = Callable[[Config], Participant]
_STOP_WAIT_S = 1.0
_AFTER_THE_RUN = 1 << 62


class Terminated(RunError):
    """The process was asked to end by a signal."""


def main(factory: Factory) -> int:
    """Take part in the run of this process's ticket; return the exit code.

    factory: makes the participant from its configuration; usually its class. Exit code 0: the
    run ended; 1: this participant could not go on, its log says why; 2: there is no ticket.
    """
    try:
        ticket = load_ticket()
    except WiringError as exc:
        return _complain(str(exc), 2)
    signal.signal(signal.SIGTERM, _terminate)
    try:
        bus = _open_bus(ticket)
    except BusError as exc:
        return _complain(f"{ticket.name}: {exc}", 1)
    try:
        take_part(factory, ticket, bus)
    except (StepbusError, KeyboardInterrupt) as exc:
        return _complain(f"{ticket.name}: {exc or type(exc).__name__}", 1)
    finally:
        bus.close()
    return 0


def _open_bus(ticket: Ticket) -> ZenohBus:
    if ticket.faults:
        return FaultyBus(ticket.endpoint, ticket.run, ticket.name, ticket.faults)
    return ZenohBus(ticket.endpoint, ticket.run)


def take_part(factory: Factory, ticket: Ticket, bus: Bus) -> None:
    """Join a run over a bus and work until it ends.

    Raises StepbusError when this participant cannot go on; the orchestrator has been told why.
    """
    bus.declare_alive(f"alive/{ticket.name}")
    inputs, outputs = (_declared(factory, side) for side in ("inputs", "outputs"))
    welcome = join(bus, ticket, inputs, outputs)
    Session(factory, welcome, bus).work()


def _declared(factory: Factory, side: str) -> dict[str, str] | None:
    """Return the ports that a participant's class wants, by type name; None: any."""
    ports: Mapping[str, PortType] | None = getattr(factory, side, None)
    if ports is None:
        return None
    return {
        port: type_name(item) if isinstance(item, type) else item for port, item in ports.items()
    }


class Session:
    """One participant's place in a run, from its `Welcome` on."""

    def __init__(self, factory: Factory, welcome: Welcome, bus: Bus) -> None:
        self._factory = factory
        self._welcome = welcome
        self._bus = bus
        self._inputs = make_inputs(welcome.inputs)
        self._sources = make_sources(self._inputs, welcome.token)
        self._subscribe()
        wake = [queue for s in self._sources for queue in (s.queue, *s.bulk_queues.values())]
        self._control = Control(bus, welcome.token, wake, welcome.name)
        self._outbox = Outbox(welcome, bus, self._drops)
        self._put_fault = bus.publisher(f"fault/{welcome.name}", encoding_of("Fault/1"))
        self._step = -1

    def _subscribe(self) -> None:
        for source in self._sources:
            self._bus.subscribe(f"out/{source.name}", source.queue.put)
            for port, queue in source.bulk_queues.items():
                self._bus.subscribe(f"bulk/{source.name}/{port}", queue.put)

    def _drops(self) -> dict[str, int]:
        """Return how many messages were dropped, by cause."""
        total: dict[str, int] = (
            {"unauthenticated": self._control.unauthenticated}
            if self._control.unauthenticated
            else {}
        )
        for source in self._sources:
            for cause, count in source.drops.items():
                total[cause] = total.get(cause, 0) + count
        return total

    def work(self) -> None:
        """Make the participant, start, step, and close it on every path."""
        participant: Participant | None = None
        try:
            participant = self._factory(Config.from_welcome(self._welcome))
            self._run(participant)
        except Stopped:
            pass
        except (OrchestratorLost, Terminated):
            raise
        except Exception as exc:
            self._report(exc)
            raise RunError(f"step {self._step}: {exc}") from exc
        finally:
            if participant is not None:
                participant.close()

    def _run(self, participant: Participant) -> None:
        ready = Ready(
            name=self._welcome.name,
            token=self._welcome.token,
            outputs=dict(participant.describe()),
            versions=dict(participant.versions()),
            calls={name: method.description for name, method in participant.calls().items()},
        )
        if len(encode(ready)) > self._welcome.max_outputs_bytes:
            raise OutputError(
                f"descriptions of {len(encode(ready))} bytes are over the bus's limit of "
                f"{self._welcome.max_outputs_bytes}; set bus.low_latency: false"
            )
        descriptions = become_ready(self._bus, ready, self._sources, self._outbox, self._control)
        participant.start(descriptions)
        loop = StepLoop(
            participant=participant,
            welcome=self._welcome,
            bus=self._bus,
            inputs=self._inputs,
            sources=self._sources,
            outbox=self._outbox,
            control=self._control,
            answers=Answers(participant.calls(), self._welcome, self._bus),
        )
        try:
            loop.run()
        finally:
            self._step = loop.step.index

    def _report(self, exc: Exception) -> None:
        """Tell the orchestrator why we cannot go on, and wait until it has heard."""
        fault = Fault(
            name=self._welcome.name,
            token=self._welcome.token,
            step=self._step,
            type=_kind(exc),
            message=_sentence(exc)[:2000],
            traceback=traceback.format_exc()[-20_000:],
            blames=exc.blames if isinstance(exc, PeerFault) else None,
        )
        sys.stderr.write(fault.traceback)
        self._put_fault(encode(fault))
        try:
            self._control.enter(_AFTER_THE_RUN)
            while self._control.wait(_STOP_WAIT_S):
                continue
        except (Stopped, OrchestratorLost):
            return


def _sentence(exc: Exception) -> str:
    return f"{type(exc).__name__}: {exc}" if _kind(exc) == "raised" else str(exc)


def _kind(exc: Exception) -> str:
    if isinstance(exc, PeerFault | OutputError):
        return "message"
    return "wiring" if isinstance(exc, WiringError) else "raised"


def _terminate(_signal: int, _frame: FrameType | None) -> None:
    raise Terminated("ended by SIGTERM")


def _complain(sentence: str, code: int) -> int:
    """Write one sentence to this process's log and return the exit code."""
    sys.stderr.write(sentence + "\n")
    return code
