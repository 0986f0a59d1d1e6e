"""Which key is listened to, and who takes what arrives on it (P3.1)."""

from collections.abc import Callable
from functools import partial
from typing import Any

from stepbus_orchestrator.run.fallback.safe_stop import SafeStop
from stepbus_orchestrator.run.kernel.messages import MessageHandler
from stepbus_participant import Request

from .session import Session


def subscribe(session: Session, messages: MessageHandler, safe_stop: SafeStop) -> None:
    """Listen to all that participants send; everything goes through the session's inbox."""
    bus, into = session.bus, session.inbox.into
    bus.answer("join", into(lambda request: _take_join(session, messages, request)))
    subscribe_named(session, "ready/*", messages.take_ready)
    subscribe_named(session, "fault/*", messages.take_fault)
    for spec in session.scenario.participants:
        # One key each: to ask every sample for its key takes longer than to decode it.
        take_log = partial(messages.take_log, spec.name)
        bus.subscribe_content(f"log/{spec.name}", session.inbox.into_from(spec.name, take_log))
    for name in safe_stop.names:
        _subscribe_one(session, f"out/{name}", partial(safe_stop.take, name))
    outputs = [out for spec in session.scenario.participants for out in spec.outputs.values()]
    if any(output.bulk for output in outputs):
        bus.subscribe("bulk/*/*", into(lambda sample: _take_bulk(session, messages, sample)))
    alive = into(lambda item: messages.take_alive(*item))
    bus.watch_alive("alive/*", lambda key, is_alive: alive((_last(key), is_alive)))
    bus.declare_alive("alive/orchestrator")


def _subscribe_one(session: Session, key: str, take: Callable[[bytes], None]) -> None:
    session.bus.subscribe_content(key, session.inbox.into(take))


def subscribe_named(session: Session, key: str, take: Callable[[str, bytes], None]) -> None:
    """Listen to keys such as `ready/*`; take: gets what is in place of the star, and the bytes."""
    bus = session.bus
    bus.subscribe(key, session.inbox.into(lambda s: take(_last(bus.key(s)), bus.payload(s))))


def _last(key: str) -> str:
    return key.rpartition("/")[2]


def _take_join(session: Session, messages: MessageHandler, request: Request) -> None:
    messages.take_join(request.payload, partial(session.announcer.reply, request))


def _take_bulk(session: Session, messages: MessageHandler, sample: Any) -> None:
    bus = session.bus
    _, name, port = bus.key(sample).split("/")
    messages.take_bulk(name, port, bus.attachment(sample), bus.payload(sample))
