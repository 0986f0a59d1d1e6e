"""How participants that take turns in one thread hand each other their outputs: without a bus."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any, Protocol

from stepbus_participant.inputs import Input
from stepbus_schemas import Waiting

from .step_loop import FLUSH_AFTER_S, StepLoop


class _Hub(Protocol):
    """Gives the thread to one participant after the other, see `inprocess.hub`."""

    current: Any

    def wait(self, hosted: Any, timeout_s: float | None) -> None: ...

    def let_go_on(self, hosted: Any) -> None: ...


class Exchange:
    """What the participants of one run know of each other.

    readers: (participant, port) → where its messages are kept until they are due, one for each
    input that reads them. steps: participant → newest step that it has published. waiting:
    participant → those that wait for it. words, places: the memory of the outside watcher, and
    where it counts the steps of each participant.
    """

    def __init__(self, hub: _Hub, words: memoryview[float], places: Mapping[str, int]) -> None:
        self.readers: dict[tuple[str, str], list[deque[tuple[int, Any]]]] = {}
        self.steps: dict[str, int] = {}
        self.waiting: dict[str, list[Any]] = {}
        self.words = words
        self.places = places
        self._hub = hub

    def join(self, name: str, every: int, inputs: Mapping[str, Input]) -> _Bell:
        """Add a participant; return what wakes it where it waits for another."""
        self.steps[name] = -every
        self.waiting.setdefault(name, [])
        for item in inputs.values():
            self.waiting.setdefault(item.config.source, [])
            row = self.readers.setdefault((item.config.source, item.config.port), [])
            row.append(item.pending)
        return _Bell(self, self._hub.current)

    def wait(self, source: str, timeout_s: float) -> None:
        """Give the thread to others until a participant has published, or the time is over [s]."""
        mine, waiting = self._hub.current, self.waiting[source]
        waiting.append(mine)
        self._hub.wait(mine, timeout_s)
        if waiting and mine in waiting:
            waiting.remove(mine)

    def wake(self, name: str) -> None:
        """Let those go on that wait for a participant."""
        waiting = self.waiting[name]
        for hosted in waiting:
            hosted.has_expired = False
            self._hub.let_go_on(hosted)
        waiting.clear()

    def ring(self, hosted: Any) -> None:
        """Let a participant go on that waits for another one."""
        if any(hosted in row for row in self.waiting.values()):
            hosted.has_expired = False
            self._hub.let_go_on(hosted)


class _Bell:
    """Stands for a queue that a participant reads while it waits for another one."""

    def __init__(self, exchange: Exchange, hosted: Any) -> None:
        self._exchange = exchange
        self._hosted = hosted

    def put(self, _item: object) -> None:
        """Wake it."""
        self._exchange.ring(self._hosted)


class ExchangingLoop(StepLoop):
    """The step loop of a participant whose sources, and readers, take turns with it.

    What it reads is where it belongs when it was published; nothing is decoded but the messages.
    """

    _exchange: Exchange

    def _work(self) -> None:
        """Step until the orchestrator stops the run; what a step needs is looked up before."""
        control, outbox, step, steps = self._control, self._outbox, self.step, self._exchange.steps
        first, every, now_ns = self._first, self._every, self._now_ns
        update, output, hand_over = self._update, self._output, outbox.hand_over
        links = [(source.name, source.delay, source.every) for source in self._sources]
        inputs = [(item, item.pending, item.settle) for item in self._inputs]
        outbox.join(self._exchange)
        while True:
            index = control.step = step.index
            started, self._waited_ns = now_ns(), 0
            if index >= control.step_limit or control.stop is not None:
                self._await_release(index)
            if first:
                # No input of this step may reach these outputs (P5.3).
                hand_over(index, output(step), step.end_reason)
                step.end_reason = None
            for source, delay, source_every in links:
                # As of `due_step`; a call would take longer than all else.
                reach = index - delay
                if steps[source] < reach - reach % source_every:
                    self._await(source, reach - reach % source_every)
            for item, pending, settle in inputs:
                if pending:
                    settle(index)
                else:
                    item.fresh = False
            messages = update(step)
            if not first:
                hand_over(index, messages, step.end_reason)
                step.end_reason = None
            elif messages:
                self._refuse(messages)
            outbox.finish(index, self._waited_ns, now_ns() - started - self._waited_ns)
            step.index += every

    def _await_release(self, step: int) -> None:
        self._control.enter(step)
        if step >= self._control.step_limit:
            self._await_trigger(step)

    def _await(self, source: str, due: int) -> None:
        """Wait for a source, however long it takes (P6.2)."""
        start_ns, timeout, exchange = self._now_ns(), FLUSH_AFTER_S, self._exchange
        exchange.wait(source, timeout)
        while exchange.steps[source] < due:
            if not self._control.poll() and timeout == FLUSH_AFTER_S:
                self._outbox.flush(Waiting(step=self.step.index, sources=[source]))
                timeout = 1.0
            exchange.wait(source, timeout)
        self._waited_ns += self._now_ns() - start_ns
