"""Compares what participants publish with what is recorded of them, step by step."""

from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence

import msgspec

from stepbus_orchestrator.analysis.divergence import PortComparison
from stepbus_orchestrator.analysis.tolerance import Tolerance
from stepbus_orchestrator.recording import Descriptions, Recording, Sink
from stepbus_orchestrator.recording.layout import topic_of
from stepbus_orchestrator.recording.step_order import Published
from stepbus_orchestrator.replay.recorded import Ports, RecordedOutputs
from stepbus_orchestrator.run.extensions.calls import recorded_calls
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.schedule import Schedule
from stepbus_schemas import CallRecord, Description


class Comparison:
    """Compares all that a run records below a step, and records what does not count as recorded.

    sink: of the run. scenario: of the run. until: the first step that is not compared. starts_at:
    participants that start behind step 0, or at `FAR` and thus never, each with its step: what is
    before is taken from the recording. counts_from: participants that are not those of the
    recording, each with the step from which its own outputs count; below, the recorded ones do.

    outputs: the recorded ones. reached: all steps below it have been compared.
    """

    def __init__(
        self,
        sink: Sink,
        recording: Recording,
        scenario: Scenario,
        *,
        until: int = FAR,
        starts_at: Mapping[str, int],
        counts_from: Mapping[str, int],
        tolerance: Tolerance | None = None,
    ) -> None:
        self.reached = 0
        self._sink = sink
        self._recording = recording
        self._scenario = scenario
        self.outputs = RecordedOutputs(recording, scenario.participants)
        self._until = until
        self._starts_at = starts_at
        self._counts_from = counts_from
        self._order = [scenario.participant(name) for name in Schedule.of(scenario).order]
        self._comparisons = {
            spec.name: {
                port: PortComparison(
                    topic_of(spec.name, port),
                    output.type,
                    tolerance or Tolerance(),
                    recording.types,
                )
                for port, output in spec.outputs.items()
            }
            for spec in self._order
            if starts_at.get(spec.name, 0) < FAR
        }
        # Nobody makes them again: a checkpoint has what they changed, or nobody is there.
        self._made: deque[CallRecord] = deque()
        self._calls: deque[CallRecord] = deque()
        for call in recorded_calls(recording):
            is_made = call.step < starts_at.get(call.participant, 0)
            (self._made if is_made else self._calls).append(call)

    def check_descriptions(self, descriptions: Descriptions) -> None:
        """Look for outputs that are described otherwise than recorded."""
        for name, ports in self._comparisons.items():
            for port in ports:
                recorded = self._recording.ports.get(topic_of(name, port))
                now = descriptions.get(name, {}).get(port, Description())
                if recorded is not None and recorded.description != now:
                    self._describes_otherwise(name, port)

    def revise(
        self, step: int, published: Sequence[Published], closing: Collection[str] | None
    ) -> Sequence[Published]:
        """Compare the outputs of a step; return what is to be recorded of it."""
        while self._made and self._made[0].step <= step:
            self._sink.write_call(self._made.popleft())
        if step >= self._until:
            return published
        own = {item.participant: item for item in published}
        revised = list(self._revised(step, own, closing))
        self.reached = step + 1
        return revised

    def _revised(
        self, step: int, own: Mapping[str, Published], closing: Collection[str] | None
    ) -> Iterator[Published]:
        for spec in self._order:
            name = spec.name
            is_played = step < self._starts_at.get(name, 0)
            if is_played and step % spec.every == 0 and (closing is None or name in closing):
                content = list(self.outputs.take(name, step).items())
                yield Published(participant=name, step=step, content=content)
            elif name in own and own[name].fault is not None:
                yield own[name]
            elif name in own:
                recorded = self.outputs.take(name, step)
                if step < self._counts_from.get(name, 0):
                    yield msgspec.structs.replace(own[name], content=list(recorded.items()))
                else:
                    self._compare(name, step, recorded, dict(own[name].content))
                    yield own[name]

    def _compare(self, name: str, step: int, recorded: Ports, own: Ports) -> None:
        for port, comparison in self._comparisons[name].items():
            if not comparison.take(step, recorded.get(port), own.get(port)):
                self._differs(name, port, step, own.get(port))

    def revise_call(self, call: CallRecord) -> CallRecord:
        """Compare a call that is made again; return what is to be recorded of it."""
        if call.step >= self._until or not self._calls:
            return call
        recorded = self._calls.popleft()
        if call.step < self._counts_from.get(call.participant, 0):
            return recorded
        if msgspec.msgpack.encode(call) != msgspec.msgpack.encode(recorded):
            self._answers_otherwise(call, recorded)
        return call

    # --- what follows from it -----------------------------------------------------------------

    def _describes_otherwise(self, name: str, port: str) -> None:
        """Take an output that is described otherwise than recorded."""
        raise NotImplementedError

    def _differs(self, name: str, port: str, step: int, own: bytes | None) -> None:
        """Take the message of a step that is not the recorded one; None: there is none."""
        raise NotImplementedError

    def _answers_otherwise(self, call: CallRecord, recorded: CallRecord) -> None:
        """Take an answer that is not the recorded one."""
        raise NotImplementedError
