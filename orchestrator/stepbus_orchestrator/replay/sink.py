"""What participants published in the recording, kept until they have published it again."""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence

import msgspec

from stepbus_orchestrator.analysis.divergence import PortComparison
from stepbus_orchestrator.analysis.tolerance import Tolerance
from stepbus_orchestrator.errors import Diverged, argument
from stepbus_orchestrator.recording import Descriptions, Recording, SavedState, Sink
from stepbus_orchestrator.recording.layout import topic_of
from stepbus_orchestrator.replay.recorded import Recorded
from stepbus_orchestrator.run.kernel.failures import at as at_step
from stepbus_orchestrator.scenario import ParticipantSpec, Scenario
from stepbus_schemas import CallRecord, Description, Outputs

Ports = dict[str, bytes]
"""Port → the bytes of its message, or of its bulk content."""


class Expected:
    """The outputs of all participants below a step, read once and taken twice.

    Once as inputs of others, ahead; and once more to compare.
    """

    def __init__(self, recording: Recording, specs: Iterable[ParticipantSpec], at: int) -> None:
        self._at = at
        self._recorded = {spec.name: Recorded(recording, spec) for spec in specs}
        self._ahead: dict[str, deque[tuple[int, Ports]]] = {
            name: deque() for name in self._recorded
        }

    def below(self, name: str, step: int) -> Iterable[tuple[int, Ports]]:
        """Yield the next outputs of a participant, those of steps below `step` and the end."""
        recorded = self._recorded[name]
        while recorded.step < min(step, self._at):
            expected = recorded.step, recorded.take()
            self._ahead[name].append(expected)
            yield expected

    def take(self, name: str, step: int) -> Ports:
        """Return the outputs of a step, in the order of steps, and forget them."""
        ahead = self._ahead[name]
        while ahead and ahead[0][0] < step:
            ahead.popleft()
        return ahead.popleft()[1] if ahead and ahead[0][0] == step else {}


_WHY = (
    "it got its recorded inputs, so it is not deterministic, or not the program that was recorded; "
    "see docs/guide/testing/branch.md"
)
_WHY_RESTORED = (
    "it started from its checkpoint before step {step}, which does not have all of its state, or "
    "it is not the program that was recorded; branch with {without}"
)


class PrefixSink:
    """Takes the outputs of a run: below `at`, each has to be the recorded one, byte for byte.

    Of a participant in `counts_from`, the recorded outputs are taken instead of its own below its
    step; so they are of one in `restored` before its checkpoint. recorder: gets all of them. calls:
    those that the recording has.

    Raises Diverged with the first difference, and the participant that made it.
    """

    def __init__(
        self,
        recorder: Sink,
        recording: Recording,
        scenario: Scenario,
        expected: Expected,
        *,
        at: int,
        counts_from: Mapping[str, int],
        restored: Mapping[str, SavedState],
        calls: Sequence[CallRecord],
    ) -> None:
        self._recorder = recorder
        self._recording = recording
        self._scenario = scenario
        self._expected = expected
        self._at = at
        self._counts_from = counts_from
        self._restored = restored
        self._calls = [call for call in calls if call.step < at and not self._is_saved(call)]
        self._saved_calls = deque(call for call in calls if self._is_saved(call))
        self._comparisons = {
            (spec.name, port): PortComparison(
                topic_of(spec.name, port), output.type, Tolerance(), recording.types
            )
            for spec in scenario.participants
            for port, output in spec.outputs.items()
        }
        self._announced: dict[tuple[str, str, int], bytes] = {}
        self._early: dict[tuple[str, str, int], bytes] = {}

    def _is_saved(self, call: CallRecord) -> bool:
        """Return whether a checkpoint has what a call has changed."""
        checkpoint = self._restored.get(call.participant)
        return checkpoint is not None and call.step < checkpoint.step

    def open_channels(
        self, descriptions: Descriptions, versions: Mapping[str, Mapping[str, str]]
    ) -> None:
        """Register the channels; raises Diverged where an output is described otherwise."""
        for spec in self._scenario.participants:
            for port in spec.outputs:
                recorded = self._recording.ports.get(topic_of(spec.name, port))
                now = descriptions.get(spec.name, {}).get(port, Description())
                if recorded is not None and recorded.description != now:
                    self._refuse_description(spec.name, port)
        self._recorder.open_channels(descriptions, versions)

    def _refuse_description(self, name: str, port: str) -> None:
        if name not in self._counts_from:
            raise Diverged(
                f"before the first step: {name} describes {port} (names, units, limits) not as "
                f"recorded; it is not the program that was recorded",
                participant=name,
            )

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Record a fact about the run."""
        self._recorder.add_metadata(name, content)

    def add_call(self, call: CallRecord) -> None:
        """Record a call; below `at`, its answer has to be the recorded one."""
        if call.step < self._at and self._calls:
            recorded = self._calls.pop(0)
            if call.step < self._counts_from.get(call.participant, 0):
                call = recorded
            elif msgspec.msgpack.encode(call) != msgspec.msgpack.encode(recorded):
                where = at_step(call.step, self._scenario.step_ns)
                raise Diverged(
                    f"{where}: {call.participant} answers the call {call.method} with "
                    f"{call.error or call.value!r}, recorded is "
                    f"{recorded.error or recorded.value!r}; {_WHY}",
                    participant=call.participant,
                    step=call.step,
                )
        self._recorder.add_call(call)

    def offer(self, name: str, outputs: Outputs) -> None:
        """Compare the outputs of one participant, and record them."""
        step = outputs.step
        if step >= self._at:
            self._recorder.offer(name, outputs)
            return
        recorded = self._expected.take(name, step)
        if step < self._counts_from.get(name, 0):
            self._record(name, outputs, recorded)
            return
        for port in self._scenario.participant(name).outputs:
            if port in outputs.bulk and port in recorded:
                self._announce(name, port, step, recorded[port])
            else:
                raw = outputs.ports.get(port)
                own = b"" if port in outputs.bulk else None if raw is None else bytes(raw)
                self._compare(name, port, step, recorded.get(port), own)
        self._recorder.offer(name, outputs)

    def offer_as_recorded(self, name: str, outputs: Outputs) -> None:
        """Record what a participant published before the checkpoint that it starts from."""
        self._record(name, outputs, self._expected.take(name, outputs.step))

    def _record(self, name: str, outputs: Outputs, recorded: Ports) -> None:
        """Record what the recording has, whatever the participant has published."""
        ports = self._scenario.participant(name).outputs
        bulk = {port: data for port, data in recorded.items() if ports[port].bulk}
        plain = {port: msgspec.Raw(data) for port, data in recorded.items() if port not in bulk}
        sizes = {port: len(data) for port, data in bulk.items()}
        replaced = msgspec.structs.replace(outputs, ports=plain, bulk=sizes, end=None)
        self._recorder.offer(name, replaced)
        for port, data in bulk.items():
            self._recorder.offer_bulk(name, port, outputs.step, data)

    def offer_bulk(self, name: str, port: str, step: int, content: bytes) -> None:
        """Compare the content of a bulk port once its outputs have announced it."""
        key = (name, port, step)
        if step >= self._at:
            self._recorder.offer_bulk(name, port, step, content)
        elif step < self._counts_from.get(name, 0):
            return
        elif key in self._announced:
            self._compare(name, port, step, self._announced.pop(key), content)
            self._recorder.offer_bulk(name, port, step, content)
        else:
            self._early[key] = content

    def _announce(self, name: str, port: str, step: int, recorded: bytes) -> None:
        self._announced[name, port, step] = recorded
        early = self._early.pop((name, port, step), None)
        if early is not None:
            self.offer_bulk(name, port, step, early)

    def _compare(
        self, name: str, port: str, step: int, recorded: bytes | None, own: bytes | None
    ) -> None:
        comparison = self._comparisons[name, port]
        if comparison.take(step, recorded, own) or comparison.divergence is None:
            return
        difference = comparison.divergence.text("recording", "now")
        text = difference.removeprefix(f"step {step}: ")
        checkpoint = self._restored.get(name)
        why = (
            _WHY
            if checkpoint is None
            else _WHY_RESTORED.format(
                without=argument("--no-checkpoints", "checkpoints=False"), step=checkpoint.step
            )
        )
        raise Diverged(
            f"{at_step(step, self._scenario.step_ns)}: {name} does not repeat the recording: "
            f"{text}; {why}",
            participant=name,
            step=step,
        )

    def is_compared(self) -> bool:
        """Return whether all that was announced has been compared."""
        return not self._announced

    def bulk_complete(self) -> bool:
        """Return whether all announced bulk content has arrived."""
        return self._recorder.bulk_complete()

    def write_below(self, step: int) -> None:
        """Write all steps below `step`, and the calls that nobody makes again before theirs."""
        while self._saved_calls and self._saved_calls[0].step < step:
            call = self._saved_calls.popleft()
            self._recorder.write_below(call.step)
            self._recorder.add_call(call)
        self._recorder.write_below(step)

    def flush(self) -> None:
        """Keep what is written safe from a kill."""
        self._recorder.flush()

    def finish(self, closing_step: int, closing: Sequence[str]) -> None:
        """End the recording."""
        self._recorder.finish(closing_step, closing)
