"""The step loop of a participant."""

import contextlib
from collections.abc import Mapping
from pathlib import Path
from queue import Empty
from typing import Any, NoReturn

from stepbus_participant.bus import Bus
from stepbus_participant.bus.slots import SlotError, Slots
from stepbus_participant.bus.ticket import Ticket
from stepbus_participant.inputs import Input, PeerFault, Source
from stepbus_participant.participant import Participant, Step, StepsOver
from stepbus_schemas import HANDSHAKE_STEP, Message, Outputs, Waiting, Welcome, reached

from .checkpoints import Checkpoints
from .control import Control, Stopped
from .outbox import Outbox, OutputError, read_stamp
from .profile import Profiler

FLUSH_AFTER_S = 0.02
"""A wait longer than this sends the log batch (P9.2.4) [s]."""


class StepLoop:
    """Runs the steps of one participant, as triggers and inputs allow (P5, P6)."""

    def __init__(
        self,
        participant: Participant,
        welcome: Welcome,
        bus: Bus,
        *,
        inputs: dict[str, Input],
        sources: list[Source],
        outbox: Outbox,
        control: Control,
        slots: Slots,
        ticket: Ticket,
    ) -> None:
        self._output, self._update = participant.output, participant.update
        self._profiler: Profiler | None = None
        if ticket.profile is not None:
            self._profiler = Profiler(Path(ticket.profile.folder) / f"{welcome.name}.csv")
            self._output = self._profiler.timed(self._output)
            self._update = self._profiler.timed(self._update)
        self._bus, self._exchange = bus, bus.exchange
        self._now_ns = bus.clock.monotonic_ns
        self._every = welcome.every
        self._first = welcome.publishes == "first"
        has_output = type(participant).output is not Participant.output
        self._forgot_first = bool(welcome.outputs) and has_output and not self._first
        self._token = welcome.token
        self._inputs = list(inputs.values())
        self._sources = sources
        has_bulk = any(source.bulk_queues for source in sources)
        self._reads_ahead = (
            bool(sources) and not self._first and not has_bulk and bus.exchange is None
        )
        self._outbox = outbox
        # Until here, empty batches have proven the link.
        outbox.record_ns = 0
        self._control = control
        self._slots = slots
        checkpoints = Checkpoints(
            participant, welcome, bus, order=ticket.checkpoint, inputs=inputs, sources=sources
        )
        self._checkpoints = checkpoints if ticket.checkpoint.every else None
        self._waited_ns = 0
        self._awaited: Source | None = None
        """The source that came last at the step before."""
        self.step = Step(inputs, welcome.step_ns)
        self.step.index = checkpoints.restore()

    def run(self) -> None:
        """Step until the orchestrator stops the run; raises what the participant raises."""
        try:
            self._work()
        except StepsOver:
            self._await_stop()
        except Stopped as stopped:
            self._close(stopped.stop.at_step)
        finally:
            self._outbox.flush()
            if self._profiler is not None:
                self._profiler.write()

    def _work(self) -> None:
        while True:
            self._control.enter(self.step.index)
            self._one_step()
            self.step.index += self._every

    def _await_stop(self) -> None:
        """Report all steps that are done, and wait until the run ends before the next one."""
        self._outbox.flush(Waiting(step=self.step.index, sources=[]))
        with contextlib.suppress(Stopped):
            self._control.enter(self.step.index)
            while True:
                self._control.wait(1.0)

    def _one_step(self) -> None:
        step = self.step
        started = self._now_ns()
        self._waited_ns = 0
        if self._checkpoints is not None:
            # Before the wait, in which calls before this step are answered (P16.2).
            self._checkpoints.save_if_due(step.index)
        if step.index >= self._control.step_limit:
            self._outbox.send_held()
            self._await_trigger(step.index)
        if self._first:
            # No input of this step may reach these outputs (P5.3).
            self._publish(self._output(step))
            self._outbox.flush_full()
        last = self._awaited
        if last is not None and last.is_awaited(step.index):
            # The others are there by then: several sources wake this thread once. They are read in
            # their order all the same, so that of several faults always the same one is raised.
            last.entries.append(self._next(last, last.queue))
        for source in self._sources:
            due = source.due(step.index)
            while source.step < due:
                self._receive(source)
        for item in self._inputs:
            item.settle(step.index)
        messages = self._update(step)
        if not self._first:
            self._publish(messages)
        elif messages:
            self._refuse(messages)
        self._finish(self._now_ns() - started - self._waited_ns)

    def _refuse(self, messages: Mapping[str, Message]) -> NoReturn:
        raise OutputError(
            f"step {self.step.index}: update returned {', '.join(messages)}, but with `publishes: "
            "first` the outputs of this step are already published; return them from `output`"
        )

    def _finish(self, computed_ns: int) -> None:
        outbox, step = self._outbox, self.step.index
        others_ns = computed_ns - outbox.record_ns
        outbox.finish(step, self._waited_ns, computed_ns)
        if self._profiler is not None:
            self._profiler.finish(step, self._waited_ns, others_ns, outbox.record_ns)
        outbox.record_ns = 0

    def _publish(self, messages: Mapping[str, Message] | None) -> None:
        step = self.step
        if messages is None and self._forgot_first and step.index < self._every:
            raise OutputError(
                f"step {step.index}: update returned nothing, and `output` is called only with "
                "`publishes: first` in the scenario; write it there"
            )
        self._outbox.publish(step.index, messages, step.end_reason)
        # Why the run should end is absent in all other outputs (P7.4).
        step.end_reason = None

    def _close(self, at_step: int) -> None:
        """Publish the closing outputs of a participant that publishes first (P11.3)."""
        if self._first and self.step.index == at_step and self._outbox.step < at_step:
            self._outbox.publish(at_step, self._output(self.step))

    def _await_trigger(self, step: int) -> None:
        start_ns = self._now_ns()
        self._control.poll()
        timeout, has_reported = FLUSH_AFTER_S, False
        if self._reads_ahead and step >= self._control.step_limit and not self._control.calls:
            timeout = self._read_ahead(step)
            self._control.poll()
        while step >= self._control.step_limit:
            self._control.answer_calls()
            if not self._control.wait(timeout) and not has_reported:
                self._outbox.flush(Waiting(step=step, sources=[]))
                timeout, has_reported = 1.0, True
        self._waited_ns += self._now_ns() - start_ns
        if has_reported:
            # The report may have crossed what was waited for (P9.3.3).
            self._outbox.flush()

    def _read_ahead(self, step: int) -> float:
        """Wait for the inputs of a step that is not released yet; return what is left of 20 ms [s].

        The trigger arrives meanwhile: to wait for it first would wake this thread once more, which
        takes longer than all else that a trigger costs. What arrives is not read before it (P5.2):
        the run may end before this step.
        """
        until_s = self._bus.clock.monotonic() + FLUSH_AFTER_S
        left_s = FLUSH_AFTER_S
        for source in self._sources:
            if source.is_awaited(step):
                try:
                    data = source.queue.get(timeout=left_s)
                except Empty:
                    return 0.0
                left_s = max(0.0, until_s - self._bus.clock.monotonic())
                if data is None:
                    # The orchestrator has sent something urgent.
                    break
                source.entries.append(data)
        return left_s

    def _receive(self, source: Source) -> None:
        """Accept the next message of a source, however long it takes to arrive (P6.2)."""
        entries = source.entries
        outputs = source.accept(entries.popleft() if entries else self._next(source, source.queue))
        if outputs is not None and outputs.bulk:
            for port, size in outputs.bulk.items():
                if port not in source.bulk_queues:
                    continue
                if port in outputs.slots:
                    self._read_slot(source, outputs, port, size)
                else:
                    self._receive_bulk(source, outputs, port, size)

    def _read_slot(self, source: Source, outputs: Outputs, port: str, size: int) -> None:
        """Offer bulk content in its slot, which nobody reuses before its due step is done (P17)."""
        step, offset = outputs.step, outputs.slots[port]
        try:
            content = self._slots.content(source.name, port, offset=offset, step=step, length=size)
        except SlotError as exc:
            where = f"step {step}: {source.name}.{port}"
            raise PeerFault(source.name, f"{where}: {exc}") from exc
        source.offer_bulk(outputs, port, content)

    def _receive_bulk(self, source: Source, outputs: Outputs, port: str, size: int) -> None:
        while True:
            sample = self._next(source, source.bulk_queues[port])
            stamp = read_stamp(sample.attachment, self._token)
            if stamp == outputs.step:
                break
            if stamp != HANDSHAKE_STEP:
                source.drop("unauthenticated" if stamp is None else "stale")
        content = sample.payload
        if len(content) != size:
            reached("bulk content is not as long as announced")
            raise PeerFault(
                source.name,
                f"step {outputs.step}: {source.name} announced {size} bytes on bulk port "
                f"{port!r} and sent {len(content)}",
            )
        source.offer_bulk(outputs, port, content)

    def _next(self, source: Source, queue: Any) -> Any:
        """Return the next item of a queue; None in it means that the orchestrator has sent."""
        if not queue.empty():
            item = queue.get()  # no time-out: it is not empty
            if item is not None:
                return item
            self._control.poll()
        start_ns = self._now_ns()
        timeout = FLUSH_AFTER_S
        while True:
            try:
                item = queue.get(timeout=timeout)
            except Empty:
                if timeout == FLUSH_AFTER_S:
                    reached("a participant says what it waits for")
                    self._outbox.flush(Waiting(step=self.step.index, sources=[source.name]))
                    timeout = 1.0
                self._control.poll()
                continue
            if item is not None:
                self._waited_ns += self._now_ns() - start_ns
                if timeout != FLUSH_AFTER_S:
                    self._outbox.flush()
                if len(self._sources) > 1 and queue is source.queue:
                    self._awaited = source
                return item
            self._control.poll()
