"""How a participant enters a run: admission, then the handshakes with its peers."""

import os
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from stepbus_participant.bus import Bus
from stepbus_participant.bus.ticket import Ticket
from stepbus_participant.inputs import Source
from stepbus_participant.packages import installed_version
from stepbus_participant.participant import PortType
from stepbus_schemas import (
    HANDSHAKE_STEP,
    SHIPPED,
    SPOKEN,
    Decoder,
    Hello,
    MessageError,
    Protocols,
    Ready,
    Refusal,
    RunError,
    Start,
    Types,
    Waiting,
    Welcome,
    encode,
    encoding_of,
    reached,
    type_name,
)

from .control import Control
from .outbox import Outbox

_decode_welcome = Decoder(Welcome)
_decode_refusal = Decoder(Refusal)
_RETRY_S = 0.05
_REPEAT_S = 0.02
_DELIVERY_S = 10.0


class AdmissionRefused(RunError, PermissionError):
    """The orchestrator did not admit this participant."""


class Ports(NamedTuple):
    """What a program demands: port → type, None where it takes any, and the types of its own."""

    inputs: dict[str, str] | None
    outputs: dict[str, str] | None
    types: Types


def declared_ports(factory: object) -> Ports:
    """Return the ports that a class of participants declares."""
    inputs, outputs = (getattr(factory, side, None) for side in ("inputs", "outputs"))
    ports = [*(inputs or {}).values(), *(outputs or {}).values()]
    types = Types.of(item for item in ports if isinstance(item, type))
    return Ports(_type_names(inputs), _type_names(outputs), types)


def _type_names(ports: Mapping[str, PortType] | None) -> dict[str, str] | None:
    if ports is None:
        return None
    return {
        port: type_name(item) if isinstance(item, type) else item for port, item in ports.items()
    }


def join(
    bus: Bus,
    ticket: Ticket,
    inputs: Mapping[str, str] | None = None,
    outputs: Mapping[str, str] | None = None,
    types: Types = SHIPPED,
    *,
    spoken: Protocols = SPOKEN,
) -> Welcome:
    """Ask the orchestrator for admission until it answers (P4.2).

    inputs, outputs: port → type, for a program that only works with certain ones. types: those of
    its own that it knows. spoken: the protocol numbers of this program.

    The first valid `Welcome` counts; an answer from another one only where there is none.
    Raises AdmissionRefused, or RunError when nothing answers within the join time-out.
    """
    protocol = spoken.common(ticket.protocols) or spoken.highest
    asked = {
        "protocol": protocol,
        "lowest_protocol": None if protocol == spoken.lowest else spoken.lowest,
        "language": "python",
        "sdk": f"stepbus {installed_version('stepbus')}",
        "inputs": inputs,
        "outputs": outputs,
        "types": types.declarations,
        "batches": True,
    }
    deadline = bus.clock.monotonic() + ticket.join_timeout_s
    while (left_s := deadline - bus.clock.monotonic()) > 0:
        refusal: RunError | None = None
        # Never 0, which means no time-out.
        for answer in _ask(bus, ticket.name, ticket.token, max(_RETRY_S, left_s), **asked):
            try:
                return _read_answer(answer, ticket, spoken)
            except RunError as exc:
                refusal = refusal or exc
        if refusal is not None:
            raise refusal
        bus.clock.sleep(_RETRY_S)
    reached("no orchestrator answers")
    raise RunError(
        f"{ticket.name}: no orchestrator answered on {ticket.endpoint.connect} within "
        f"{ticket.join_timeout_s} s; is it still running?"
    )


def await_delivery(bus: Bus, welcome: Welcome) -> None:
    """Wait until the orchestrator has what was published so far, 10 s at most.

    A session that closes drops what it has not sent yet, unless its transport is the one of low
    latency: the last `Log`, on a busy machine. An answer to one more `Hello` (P4.2) shows that it
    is out.
    """
    again = _ask(bus, welcome.name, welcome.token, _DELIVERY_S, protocol=welcome.protocol)
    next(iter(again), None)


def _ask(bus: Bus, name: str, token: str, timeout_s: float, **more: Any) -> Iterable[bytes]:
    """Send a `Hello`; return the answers as they arrive."""
    hello = Hello(name=name, token=token, pid=os.getpid(), **more)
    return bus.query("join", encode(hello), encoding_of("Hello/1"), timeout_s)


def _read_answer(answer: bytes, ticket: Ticket, spoken: Protocols) -> Welcome:
    try:
        welcome = _decode_welcome(answer)
    except MessageError as exc:
        try:
            raise AdmissionRefused(_decode_refusal(answer).reason) from None
        except MessageError:
            raise RunError(f"the orchestrator's answer to Hello is {exc}") from exc
    if not spoken.lowest <= welcome.protocol <= spoken.highest:
        raise AdmissionRefused(
            f"the orchestrator speaks protocol {welcome.protocol}, this program {spoken}; use "
            "versions of stepbus with a common one (docs/compatibility.md)"
        )
    if (welcome.token, welcome.name) != (ticket.token, ticket.name):
        raise AdmissionRefused(
            f"the orchestrator's answer to Hello is for {welcome.name!r} or for another run"
        )
    return welcome


def await_start(
    bus: Bus, ready: Ready, sources: list[Source], outbox: Outbox, control: Control
) -> Start:
    """Exchange handshakes with consumers and sources, report ready, and wait for the start (P4.6).

    Everything is repeated until it takes effect, so no message of this phase can be lost for good.
    Raises Stopped when the run ends before it starts.
    """
    put_ready = bus.publisher(f"ready/{ready.name}", encoding_of("Ready/1"))
    while control.started is None:
        outbox.send_handshake()
        _accept_handshakes(sources)
        unconnected = [source.name for source in sources if not source.connected]
        if unconnected:
            outbox.flush(Waiting(step=HANDSHAKE_STEP, sources=unconnected))
        else:
            # The empty log proves that link before anything of value travels over it.
            outbox.flush()
            put_ready(encode(ready))
        control.wait(_REPEAT_S)
    return control.started


def _accept_handshakes(sources: list[Source]) -> None:
    for source in sources:
        # What follows the first handshake, with its bulk content, is for the step loop (P4.9).
        while not source.connected and not source.queue.empty():
            data = source.queue.get()  # no time-out: it is not empty
            if data is not None:
                source.accept(data)
