"""How participants that take turns in one thread hand each other their outputs: without a bus."""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from stepbus_participant.inputs import Input
from stepbus_schemas import Waiting

from .outbox import BATCH_AGE_NS
from .step_loop import FLUSH_AFTER_S, StepLoop


class Turns(Protocol):
    """Who gives the participants their turns. current: whose turn it is."""

    current: Any

    def pause(self, timeout_s: float) -> bool:
        """Give the thread away until let go on; return whether the time [s] was over before."""
        ...

    def let_go_on(self, one: Any) -> None:
        """Give a participant its next turn."""
        ...


class Exchange:
    """What the participants of one run know of each other.

    readers: (participant, port) → where its messages are kept until they are due, one for each
    input that reads them. known: participant → the first step whose outputs it has not published.
    waiting: participant → those that wait for it. words, places: the memory of the outside watcher,
    and where it finds that step of each participant.
    """

    def __init__(self, turns: Turns, words: "memoryview[float]", places: Mapping[str, int]) -> None:
        self.turns = turns
        self.readers: dict[tuple[str, str], list[deque[tuple[int, Any]]]] = {}
        self.known: dict[str, int] = {}
        self.waiting: dict[str, deque[Any]] = {}
        self.words = words
        self.places = places

    def join(self, name: str, inputs: Mapping[str, Input]) -> Callable[[Any], object]:
        """Add the participant whose turn it is; return what lets it go on from a wait."""
        self.known[name] = 0
        self.waiting.setdefault(name, deque())
        for item in inputs.values():
            self.waiting.setdefault(item.config.source, deque())
            row = self.readers.setdefault((item.config.source, item.config.port), [])
            row.append(item.pending)
        me, let_go_on = self.turns.current, self.turns.let_go_on
        return lambda _: let_go_on(me)


class ExchangingLoop(StepLoop):
    """The step loop of a participant whose sources, and readers, take turns with it.

    What it reads is where it belongs when it was published; nothing is decoded but the messages.
    """

    _exchange: Exchange
    _limit = 0
    """The first step at which the orchestrator's orders count."""

    def _work(self) -> None:
        """Step until the orchestrator stops the run; what a step needs is looked up before."""
        outbox, step, known = self._outbox, self.step, self._exchange.known
        first, every, now_ns = self._first, self._every, self._now_ns
        update, output, hand_over = self._update, self._output, outbox.join(self._exchange)
        outputs, batch, timed = outbox.outputs, outbox.batch, outbox.timing.append
        links = [(source.name, source.delay) for source in self._sources]
        settles = [item.settle for item in self._inputs]
        while True:
            index, started, self._waited_ns = step.index, now_ns(), 0
            if index >= self._limit:
                self._await_release(index)
            if first:
                # No input of this step may reach these outputs (P5.3).
                hand_over(index, output(step), step.end_reason)
                step.end_reason = None
            for source, delay in links:
                # As of `due_step`: it publishes nothing else up to there.
                if known[source] <= index - delay:
                    self._await(source, index - delay)
            for settle in settles:
                settle(index)
            messages = update(step)
            if not first:
                hand_over(index, messages, step.end_reason)
                step.end_reason = None
            elif messages:
                self._refuse(messages)
            ended, waited = now_ns(), self._waited_ns
            timed((index, waited, ended - started - waited))
            if len(outputs) >= batch or ended - outbox.flushed_ns > BATCH_AGE_NS:
                outbox.flush()
            step.index = index + every

    def _await_release(self, step: int) -> None:
        control = self._control
        control.enter(step)
        if step >= control.step_limit:
            self._await_trigger(step)
        self._heed_orders()

    def _heed_orders(self) -> None:
        stop, limit = self._control.stop, self._control.step_limit
        self._limit = limit if stop is None else min(limit, stop.at_step)

    def _await(self, source: str, step: int) -> None:
        """Wait until all outputs of a source up to a step are known, however long (P6.2)."""
        start_ns, timeout, exchange = self._now_ns(), FLUSH_AFTER_S, self._exchange
        turns, waiting = exchange.turns, exchange.waiting[source]
        while True:
            if turns.current not in waiting:
                waiting.append(turns.current)
            is_late = turns.pause(timeout)
            if exchange.known[source] > step:
                break
            if is_late and timeout == FLUSH_AFTER_S:
                self._outbox.flush(Waiting(step=self.step.index, sources=[source]))
                timeout = 1.0
            self._control.step = self.step.index
            self._control.poll()
            self._heed_orders()
        self._waited_ns += self._now_ns() - start_ns
        if timeout != FLUSH_AFTER_S:
            # The report may have crossed what was waited for (P9.3.3).
            self._outbox.flush()
