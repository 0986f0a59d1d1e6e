"""Publishes outputs again that a participant waits for although they were published (P8.7)."""

from collections.abc import Iterable, Iterator

from stepbus_orchestrator.run.extension import RunView
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_schemas import Decoder, Log, MessageError, Outputs, due_step, reached

_decode_log = Decoder(Log)
_decode_outputs = Decoder(Outputs)

_SHARE = 0.25
"""Of the deadline for a step, after which outputs count as lost, and again after as much."""


class Repeats:
    """Looks for a message that was lost, and publishes it once more, byte for byte.

    The bytes are those of the source's log (P9.1). Those that it did reach drop it (P8.1). Bulk
    content is not published again.
    """

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._done: dict[str, tuple[int, int]] = {}

    def look(self, holders: Iterable[str], phase: str) -> None:
        """Publish what those that hold a step have been waiting for; call it at each check.

        phase: whose deadline counts, `step` or `stop`.
        """
        for name in holders:
            participant = self._run.state.participants[name]
            turn = int(participant.holds_s / (_SHARE * participant.limit_s(phase)))
            if turn and self._done.get(name, (-1, 0)) < (participant.held_step, turn):
                self._done[name] = (participant.held_step, turn)
                self._repeat(participant)

    def _repeat(self, participant: ParticipantState) -> None:
        waiting = participant.waiting
        if waiting is None or participant.process.activity().is_stopped:
            return
        for source in waiting.sources:
            steps = self._lost(participant, source, waiting.step)
            entries = dict(self._entries(source, steps))
            if len(entries) < len(steps) or not steps:
                continue
            reached("a message is published again")
            put = self._run.session.publisher(f"out/{source}", "Outputs/1")
            for step in steps:
                put(entries[step])
            self._run.timing.event("repeat", source, f"step {steps[-1]} for {participant.name}")
            text = f"{participant.name} has waited for {participant.holds_s:.1f} s for its outputs"
            text += " of this step: a message was lost, and is published again"
            self._run.observer.event("warning", source, steps[-1], text)

    def _lost(self, participant: ParticipantState, source: str, step: int) -> range:
        """Return the steps whose outputs a participant may lack to do a step; empty: none."""
        every = self._run.state.participants[source].spec.every
        inputs = [item for item in participant.spec.inputs.values() if item.source == source]
        newest = max((due_step(step, item.delay, every) for item in inputs), default=-1)
        if not 0 <= newest <= self._run.state.barrier.reported[source]:
            return range(0)
        # One that fires less often takes several at a time.
        taken = max(participant.spec.every // every, 1)
        return range(max(newest - (taken - 1) * every, 0), newest + 1, every)

    def _entries(self, source: str, steps: range) -> Iterator[tuple[int, bytes]]:
        """Yield the outputs of some steps, as they stand in a source's newest logs."""
        for data in self._run.messages.logs[source]:
            try:
                for raw in _decode_log(data).outputs:
                    step = _decode_outputs(raw).step
                    if step in steps:
                        yield step, bytes(raw)
            except MessageError:
                # It has been reported (P8.6).
                continue
