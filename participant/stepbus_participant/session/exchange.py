"""How participants that take turns in one thread hand each other their outputs: without a bus."""

from collections import deque
from collections.abc import Mapping
from queue import Empty
from typing import Any

from stepbus_participant.bus import Queue
from stepbus_participant.inputs import Input
from stepbus_schemas import Waiting

from .step_loop import FLUSH_AFTER_S, StepLoop


class Exchange:
    """What the participants of one run know of each other.

    readers: (participant, port) → where its messages are kept until they are due, one for each
    input that reads them. steps: participant → newest step that it has published. waiting:
    participant → the queues of those that wait for it. queues: participant → its own, which holds
    nothing but what wakes it. words, places: the memory of the outside watcher, and where it counts
    the steps of each participant.
    """

    def __init__(self, words: "memoryview[float]", places: Mapping[str, int]) -> None:
        self.readers: dict[tuple[str, str], list[deque[tuple[int, Any]]]] = {}
        self.steps: dict[str, int] = {}
        self.waiting: dict[str, list[Queue]] = {}
        self.queues: dict[str, Queue] = {}
        self.words = words
        self.places = places

    def join(self, name: str, every: int, inputs: Mapping[str, Input], queue: Queue) -> None:
        """Add a participant, with a queue of its bus."""
        self.steps[name], self.queues[name] = -every, queue
        self.waiting.setdefault(name, [])
        for item in inputs.values():
            self.waiting.setdefault(item.config.source, [])
            row = self.readers.setdefault((item.config.source, item.config.port), [])
            row.append(item.pending)

    def wake(self, name: str) -> None:
        """Let those go on that wait for a participant."""
        for queue in self.waiting[name]:
            queue.put(None)
        self.waiting[name].clear()


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
        queue, waiting = exchange.queues[self._outbox.name], exchange.waiting[source]
        while exchange.steps[source] < due:
            if queue not in waiting:
                waiting.append(queue)
            try:
                queue.get(timeout=timeout)
            except Empty:
                if timeout == FLUSH_AFTER_S:
                    self._outbox.flush(Waiting(step=self.step.index, sources=[source]))
                    timeout = 1.0
            self._control.poll()
        self._waited_ns += self._now_ns() - start_ns
        if timeout != FLUSH_AFTER_S:
            # The report may have crossed what was waited for (P9.3.3).
            self._outbox.flush()
