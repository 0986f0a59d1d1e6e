"""One participant's part in a run: admission, its steps, and how it ends."""

import contextlib
import sys
import traceback
from collections.abc import Callable
from typing import Any

from stepbus_participant.bus import Bus, BusError, Queue
from stepbus_participant.bus.slots import Slots
from stepbus_participant.bus.ticket import Ticket
from stepbus_participant.config import Config
from stepbus_participant.inputs import Input, PeerFault, make_sources
from stepbus_participant.parameters.problems import SettingsError
from stepbus_participant.participant import InvalidInput, Participant
from stepbus_schemas import (
    Fault,
    Ready,
    RunError,
    Types,
    Welcome,
    WiringError,
    encode,
    encoding_of,
    error_text,
    reached,
    text_of,
    valid_unicode,
)

from .admission import await_delivery, await_start, declared_ports, join
from .control import Control, OrchestratorLost, Stopped, watched_orders
from .exchange import ExchangingLoop
from .outbox import Outbox, OutputError, names_of
from .step_loop import StepLoop

_STOP_WAIT_S = 1.0
_AFTER_THE_RUN = 1 << 62

Factory = Callable[[Config], Participant]


class Terminated(RunError):
    """A signal asked the process to end."""


def take_part(factory: Factory, ticket: Ticket, bus: Bus) -> None:
    """Join a run over a bus, and step until it ends.

    Raises StepbusError when this participant cannot continue; the orchestrator knows why.
    """
    bus.declare_alive(f"alive/{ticket.name}")
    orders = watched_orders(bus)
    ports = declared_ports(factory)
    welcome = join(bus, ticket, *ports)
    Session(factory, ticket, welcome, bus, Types(welcome.types) | ports.types, orders=orders).work()


class Session:
    """Runs one participant from its `Welcome` on.

    factory: makes the participant from its configuration. types: of the run, and of its own
    classes. orders: as of `watched_orders`.
    """

    def __init__(
        self,
        factory: Factory,
        ticket: Ticket,
        welcome: Welcome,
        bus: Bus,
        types: Types,
        *,
        orders: Queue,
    ) -> None:
        self._factory = factory
        self._ticket = ticket
        self._welcome = welcome
        self._bus = bus
        self._types = types
        drops: dict[str, int] = {}
        self._inputs = {name: Input(name, item, types) for name, item in welcome.inputs.items()}
        self._sources = make_sources(self._inputs, welcome.token, bus.queue, drops)
        wake: list[Callable[[Any], object]] = []
        for source in self._sources:
            bus.subscribe_content(f"out/{source.name}", source.queue.put)
            for port, queue in source.bulk_queues.items():
                bus.subscribe(f"bulk/{source.name}/{port}", queue.put)
            wake += [queue.put for queue in (source.queue, *source.bulk_queues.values())]
        if bus.exchange is not None:
            wake.append(bus.exchange.join(welcome.name, self._inputs))
        self._control = Control(bus, welcome, orders, wake, drops)
        self._slots = Slots(ticket.slots, welcome)
        self._outbox = Outbox(welcome, bus, drops, types)
        if ticket.faults:
            self._outbox.inject(ticket.faults)
        self._put_fault = bus.publisher(f"fault/{welcome.name}", encoding_of("Fault/1"))
        self._step = -1

    def work(self) -> None:
        """Make the participant, run it, and close it on every path.

        Raises RunError when it cannot continue, once the orchestrator knows why.
        """
        participant: Participant | None = None
        try:
            participant = self._factory(Config.from_welcome(self._welcome, self._types))
            self._run(participant)
        except Stopped:
            pass
        except (OrchestratorLost, Terminated):
            raise
        except Exception as exc:
            reached("a participant raises")
            self._report(exc)
            raise RunError(f"step {self._step}: {text_of(exc)}") from exc
        finally:
            self._slots.close()
            if participant is not None:
                participant.close()

    def _run(self, participant: Participant) -> None:
        ready = self._ready(participant)
        start = await_start(self._bus, ready, self._sources, self._outbox, self._control)
        descriptions = start.inputs.get(ready.name, {})
        self._outbox.start(
            names_of(ready.outputs, descriptions),
            self._slots.writers(start.slots),
            most_held=start.batches.get(ready.name, 1),
        )
        participant.start(descriptions)
        self._control.methods = participant.calls()
        loop = (StepLoop if self._bus.exchange is None else ExchangingLoop)(
            participant,
            self._welcome,
            self._bus,
            inputs=self._inputs,
            sources=self._sources,
            outbox=self._outbox,
            control=self._control,
            slots=self._slots,
            ticket=self._ticket,
        )
        try:
            loop.run()
            bulk = any(output.bulk for output in self._welcome.outputs.values())
            if bulk or not self._ticket.endpoint.low_latency:
                await_delivery(self._bus, self._welcome)
        finally:
            self._step = loop.step.index

    def _ready(self, participant: Participant) -> Ready:
        """Return what the participant reports before the start.

        Raises OutputError when it is large, WiringError when nothing would ever be published.
        """
        has_output = type(participant).output is not Participant.output
        if self._welcome.publishes == "first" and self._welcome.outputs and not has_output:
            raise WiringError(
                f"{type(participant).__name__} needs a method `output`: the scenario has "
                "`publishes: first`"
            )
        if self._ticket.checkpoint.every:
            participant.prepare_saves()
        ready = Ready(
            name=self._welcome.name,
            token=self._welcome.token,
            outputs=dict(participant.describe()),
            versions=dict(participant.versions()),
            calls={name: method.description for name, method in participant.calls().items()},
            slots=self._slots.names,
        )
        size, limit = len(encode(ready)), self._welcome.max_outputs_bytes
        if size > limit:
            raise OutputError(
                f"descriptions of {size} bytes exceed the bus's limit of {limit}; "
                "set bus.low_latency: false"
            )
        return ready

    def _report(self, exc: Exception) -> None:
        """Report the fault to the orchestrator, and wait for its stop (P10.1).

        The culprit is not waited for: a SIGTERM may come before the stop, even while this
        reports. What the process printed last has to be its own error.
        """
        with contextlib.suppress(Stopped, OrchestratorLost, Terminated):
            self._tell(exc)
            self._control.enter(_AFTER_THE_RUN)
            while self._control.wait(_STOP_WAIT_S):
                continue

    def _tell(self, exc: Exception) -> None:
        if isinstance(exc, InvalidInput) and exc.port in self._welcome.inputs:
            source = self._welcome.inputs[exc.port]
            where = f"{source.source}.{source.port} (input {exc.port})"
            exc = PeerFault(source.source, f"{where}: {exc.text}")
        kind = _fault_type(exc)
        text = error_text(exc) if kind == "raised" else text_of(exc)
        fault = Fault(
            name=self._welcome.name,
            token=self._welcome.token,
            step=self._step,
            type=kind,
            message=text[:2000],
            traceback=valid_unicode(traceback.format_exc()[-20_000:]),
            blames=exc.blames if isinstance(exc, PeerFault) else None,
        )
        # Wrong parameters are no bug: the sentence that follows says all.
        if not isinstance(exc, SettingsError):
            sys.stderr.write(fault.traceback)
        self._put_fault(encode(fault))


def _fault_type(exc: Exception) -> str:
    if isinstance(exc, PeerFault | OutputError):
        return "message"
    if isinstance(exc, BusError):
        return "bus"
    return "wiring" if isinstance(exc, WiringError) else "raised"
