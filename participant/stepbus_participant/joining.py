"""From a ticket to the first step: join, hear every source, be ready, start."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from importlib.metadata import version

from stepbus_schemas import (
    HANDSHAKE_STEP,
    PROTOCOL_VERSION,
    Decoder,
    Description,
    Hello,
    MessageError,
    Ready,
    Refusal,
    RunError,
    Waiting,
    Welcome,
    encode,
    encoding_of,
)

from .bus import Bus
from .control import Control
from .inputs import Source
from .outbox import Outbox
from .ticket import Ticket

_decode_welcome = Decoder(Welcome)
_decode_refusal = Decoder(Refusal)
_RETRY_S = 0.05
_HANDSHAKE_S = 0.02


class Refused(RunError, PermissionError):
    """The orchestrator did not take us in."""


def join(
    bus: Bus,
    ticket: Ticket,
    inputs: Mapping[str, str] | None = None,
    outputs: Mapping[str, str] | None = None,
) -> Welcome:
    """Ask the orchestrator to take us in, until it answers; a stranger's answer is passed over.

    inputs, outputs: port → type, where the program only works with certain ones.

    Raises Refused when it says no, RunError when nobody answers within the join time-out.
    """
    hello = Hello(
        protocol=PROTOCOL_VERSION,
        name=ticket.name,
        token=ticket.token,
        pid=os.getpid(),
        language="python",
        sdk=f"stepbus {version('stepbus')}",
        inputs=None if inputs is None else dict(inputs),
        outputs=None if outputs is None else dict(outputs),
    )
    deadline = time.monotonic() + ticket.join_timeout_s
    while time.monotonic() < deadline:
        refusal: RunError | None = None
        for answer in bus.query("join", encode(hello), encoding_of("Hello/1"), _left_s(deadline)):
            try:
                return _read_answer(answer, ticket)
            except RunError as exc:
                refusal = refusal or exc
        if refusal is not None:
            raise refusal
        time.sleep(_RETRY_S)
    raise RunError(
        f"{ticket.name}: no orchestrator answered on {ticket.endpoint.connect} within "
        f"{ticket.join_timeout_s} s; is it still running?"
    )


def _left_s(deadline: float) -> float:
    """Return the time until a deadline, at least a little: a time-out of 0 means none [s]."""
    return max(_RETRY_S, deadline - time.monotonic())


def _read_answer(answer: bytes, ticket: Ticket) -> Welcome:
    try:
        welcome = _decode_welcome(answer)
    except MessageError as exc:
        try:
            raise Refused(_decode_refusal(answer).reason) from None
        except MessageError:
            raise RunError(f"the answer to our Hello is {exc}") from exc
    if welcome.protocol != PROTOCOL_VERSION:
        raise Refused(
            f"the orchestrator speaks protocol {welcome.protocol}, this program {PROTOCOL_VERSION}"
        )
    if (welcome.token, welcome.name) != (ticket.token, ticket.name):
        raise Refused(f"the answer to our Hello is for {welcome.name!r} or for another run")
    return welcome


def become_ready(
    bus: Bus,
    ready: Ready,
    sources: list[Source],
    outbox: Outbox,
    control: Control,
) -> Mapping[str, Description]:
    """Send handshakes to our consumers, hear our sources, say we are ready, and wait for the start.

    Everything is repeated until it is answered, so that no message of this phase can be missed.
    Returns the descriptions of our inputs. Raises Stopped when the run ends before it starts.
    """
    put_ready = bus.publisher(f"ready/{ready.name}", encoding_of("Ready/1"))
    while control.started is None:
        outbox.send_handshake()
        _hear(bus, sources)
        unheard = [source.name for source in sources if not source.heard]
        if unheard:
            outbox.flush(Waiting(step=HANDSHAKE_STEP, sources=unheard))
        else:
            outbox.flush()
            put_ready(encode(ready))
        control.wait(_HANDSHAKE_S)
    return control.started.get(ready.name, {})


def _hear(bus: Bus, sources: list[Source]) -> None:
    """Take in the handshakes of our sources."""
    for source in sources:
        # What comes behind the first handshake, with its bulk content, is for the step loop.
        while not source.heard and not source.queue.empty():
            sample = source.queue.get()
            if sample is not None:
                source.accept(bus.payload(sample))
