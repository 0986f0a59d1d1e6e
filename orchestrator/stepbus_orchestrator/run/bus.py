"""One run's end of the bus: what is published, what has arrived, and who takes it (P3.1)."""

import contextlib
from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from queue import Empty
from typing import Any

from stepbus_orchestrator.errors import BusFailed
from stepbus_orchestrator.processes.watchdog import Watchdog
from stepbus_orchestrator.run.kernel.messages import MessageHandler
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_participant import Bus, BusError, Endpoint, Queue, Request, Sample, ZenohBus
from stepbus_schemas import CallReply, Refusal, Stop, Trigger, Welcome, encode, encoding_of


class Inbox:
    """What has arrived, in its order, each item with the function that takes it.

    Callbacks of the bus only put; everything else happens on the thread that calls `receive`.
    What several participants have to send before anything can go on wakes that thread once.

    queue: of the bus; holds no items, but what wakes the thread.
    """

    def __init__(self, queue: Queue) -> None:
        self._queue = queue
        self._items: deque[tuple[Callable[[Any], None], Any]] = deque()
        self._awaited: set[str] = set()

    def into(self, take: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a callback for the bus: what it gets is passed to `take` by `receive`."""

        def sink(item: Any) -> None:
            self._items.append((take, item))
            self._queue.put(None)

        return sink

    def into_from(self, name: str, take: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return the same for a participant; it wakes no reader while others are awaited."""
        put, keep = self._queue.put, self._items.append

        def sink(item: Any) -> None:
            keep((take, item))
            # Read after the line above: `wake_for` looks for what was kept once it has set this.
            awaited = self._awaited
            awaited.discard(name)
            if not awaited:
                put(None)

        return sink

    def wake_for(self, names: Iterable[str]) -> None:
        """Wake `receive` once each of these has sent something; none: once any has."""
        self._awaited = set(names)

    def receive(self, timeout_s: float) -> bool:
        """Wait for the next item, at most for a time [s], and take all that have come with it.

        Return whether any has come.
        """
        queue, items = self._queue, self._items
        if not items:
            with contextlib.suppress(Empty):
                queue.get(timeout=timeout_s)
        # Not until it is empty: a process that floods the bus must not keep us from the deadlines.
        count = len(items)
        for _ in range(count):
            take, item = items.popleft()
            take(item)
        # What comes from here on is in the items, and is not waited for.
        while not queue.empty():
            queue.get()  # no time-out: it is not empty
        return count > 0


_FIRST_S = 0.05
_FIRST_STOP_S = 0.01
_LONGEST_S = 60.0


class Session:
    """The bus of one run: what it publishes, under a watchdog, and its inbox.

    A put to a process that reads nothing blocks (P2.5). Start, trigger and stop are repeated until
    their effect is seen, since what is published before a link is complete is lost; less and less
    often, since each message to a frozen participant fills a buffer.

    on_block: is called on the watchdog's thread when a put takes longer than the longest deadline
    for a step, and has to end the process that reads nothing.
    """

    def __init__(
        self, scenario: Scenario, bus: Bus, token: str, on_block: Callable[[], None]
    ) -> None:
        self.scenario = scenario
        self.bus = bus
        self.token = token
        self.inbox = Inbox(bus.queue())
        longest_s = max(spec.deadlines.step_s for spec in scenario.participants)
        self._watchdog = Watchdog(longest_s, on_block, bus.clock, bus.every)
        self._put_start = self.publisher("start", "Start/1")
        self._put_trigger = self.publisher("trigger", "Trigger/1")
        self._put_stop = self.publisher("stop", "Stop/1")
        self._start = b""
        self._stop = b""
        self._step_limit = 0
        self._pause_s = _FIRST_S
        self._due_s = 0.0

    def publisher(self, key: str, type_name: str, *, remote: bool = False) -> Callable[..., None]:
        """Return a function that publishes bytes on a key; it takes `attachment=` bytes too.

        remote: the orchestrator's own subscribers do not get them.
        """
        put = self.bus.publisher(key, encoding_of(type_name), remote=remote)
        start, end = self._watchdog.start, self._watchdog.end

        def watched_put(data: bytes, **options: bytes) -> None:
            start()
            try:
                put(data, **options)
            finally:
                end()

        return watched_put

    def reply(self, request: Request, message: Welcome | Refusal | CallReply) -> None:
        """Answer a query with an envelope."""
        with self._watchdog.watching():
            request.reply(encode(message), encoding_of(f"{type(message).__name__}/1"))

    def start(self, message: bytes) -> None:
        """Publish the `Start` (P4.8)."""
        self._start = message
        self._put_start(message)

    def trigger(self, step_limit: int) -> None:
        """Release the steps below `step_limit` to every participant (P5.2)."""
        self._step_limit = step_limit
        self._set_pause(_FIRST_S)
        self._put_trigger(self._trigger())

    def stop(self, reason: str, at_step: int) -> None:
        """End every participant; negative `at_step`: at once (P11.1)."""
        self._stop = encode(Stop(token=self.token, reason=reason, at_step=at_step))
        self._set_pause(_FIRST_STOP_S)
        self._put_stop(self._stop)

    def repeat(self, *, with_start: bool) -> None:
        """Repeat the newest trigger, when it is time to; with_start: the `Start` as well."""
        if self._is_time():
            if with_start:
                self._put_start(self._start)
            self._put_trigger(self._trigger())

    def repeat_stop(self) -> None:
        """Repeat the `Stop`, when it is time to."""
        if self._is_time():
            self._put_stop(self._stop)

    def close(self) -> None:
        """Stop the watchdog; nothing is published afterwards."""
        self._watchdog.close()

    def _trigger(self) -> bytes:
        return encode(Trigger(token=self.token, step_limit=self._step_limit))

    def _set_pause(self, pause_s: float) -> None:
        self._pause_s = pause_s
        self._due_s = self.bus.clock.monotonic() + pause_s

    def _is_time(self) -> bool:
        now = self.bus.clock.monotonic()
        if now < self._due_s:
            return False
        self._pause_s = min(2 * self._pause_s, _LONGEST_S)
        self._due_s = now + self._pause_s
        return True


def open_bus(endpoint: Endpoint, run: str) -> ZenohBus:
    """Open a session on the bus of a run; raises BusFailed."""
    try:
        return ZenohBus(endpoint, run)
    except BusError as exc:
        raise BusFailed(str(exc)) from exc


def subscribe(session: Session, messages: MessageHandler) -> None:
    """Listen to all that participants send; everything goes through the session's inbox."""
    bus, inbox = session.bus, session.inbox
    bus.answer(
        "join",
        inbox.into(lambda it: messages.take_join(it.payload, partial(session.reply, it))),
    )
    subscribe_named(session, "ready/*", messages.take_ready)
    subscribe_named(session, "fault/*", messages.take_fault)
    for spec in session.scenario.participants:
        # One key each: to ask every sample for its key takes longer than to decode it.
        take_log = partial(messages.take_log, spec.name)
        bus.subscribe_content(f"log/{spec.name}", inbox.into_from(spec.name, take_log))
    outputs = [out for spec in session.scenario.participants for out in spec.outputs.values()]
    if any(output.bulk for output in outputs):

        def take_bulk(sample: Sample) -> None:
            # A put on a wildcard arrives with that as its key, of any length.
            name, _, port = sample.key.partition("/")[2].partition("/")
            messages.take_bulk(name, port, sample.attachment, sample.payload)

        bus.subscribe("bulk/*/*", inbox.into(take_bulk))
    alive = inbox.into(lambda item: messages.take_alive(*item))
    bus.watch_alive("alive/*", lambda key, is_alive: alive((_last(key), is_alive)))
    bus.declare_alive("alive/orchestrator")


def subscribe_named(session: Session, key: str, take: Callable[[str, bytes], None]) -> None:
    """Listen to keys such as `ready/*`; take: gets what is in place of the star, and the bytes."""
    session.bus.subscribe(key, session.inbox.into(lambda s: take(_last(s.key), s.payload)))


def _last(key: str) -> str:
    return key.rpartition("/")[2]
