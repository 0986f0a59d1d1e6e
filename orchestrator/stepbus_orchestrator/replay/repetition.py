"""The recorded steps of a run: they are played to its participants, and compared.

A branch repeats the steps below one, and is live from there on (`prefix.py`); a replay repeats all
steps of one participant, and plays the others (`execute.py`).
"""

from collections import deque
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial

import msgspec

from stepbus_orchestrator.analysis.divergence import PortComparison
from stepbus_orchestrator.analysis.tolerance import Tolerance
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.recording.layout import topic_of
from stepbus_orchestrator.recording.sink import Published
from stepbus_orchestrator.replay.recorded import RecordedOutputs
from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.run.extensions.calls import recorded_calls
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.run.kernel.state import RunPhase
from stepbus_orchestrator.run.player import Player, Ports
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.schedule import Schedule
from stepbus_schemas import CallRecord, Description, due_step


class Repetition(RunExtension):
    """Plays the recorded steps below a step, and compares the steps of the run with them.

    at: the first step that is not recorded. starts_at: participants that start after step 0, or at
    `FAR` and thus never, each with its step: what is before is taken from the recording.
    counts_from: participants that are not those of the recording, each with the step from which its
    own outputs count; below, the recorded ones do.
    """

    def __init__(
        self,
        recording: Recording,
        *,
        at: int = FAR,
        starts_at: Mapping[str, int],
        counts_from: Mapping[str, int],
        tolerance: Tolerance | None = None,
    ) -> None:
        self.recording = recording
        self.at = at
        self.starts_at = starts_at
        self.counts_from = counts_from
        self.comparisons: dict[str, dict[str, PortComparison]] = {}
        self._tolerance = tolerance or Tolerance()
        self._fed = 0
        self._compared = 0

    # --- playing --------------------------------------------------------------------------

    def attach(self, run: RunView) -> None:
        """Set where each participant starts; prepare the player and the comparisons."""
        super().attach(run)
        state, recording = run.state, self.recording
        state.is_repeating = True
        for name, step in self.starts_at.items():
            state.barrier.start_at(name, step)
        self._step_ns = state.scenario.step_ns
        self._order = list(map(state.scenario.participant, Schedule(state.scenario).order))
        self.outputs = RecordedOutputs(recording, state.scenario.participants)
        self.comparisons = {
            spec.name: {port: self._comparison(spec, port) for port in spec.outputs}
            for spec in self._order
            if self.starts_at.get(spec.name, 0) < FAR
        }
        # They are not made again: a checkpoint has what they changed, or the participant is played.
        self._made: deque[CallRecord] = deque()
        self._calls: deque[CallRecord] = deque()
        for call in recorded_calls(recording):
            is_made = call.step < self.starts_at.get(call.participant, 0)
            (self._made if is_made else self._calls).append(call)
        run.recorder.reviser = self
        self._needed = _needed(state.scenario, self.starts_at)
        self._played = [s for s in state.scenario.participants if s.name in self._needed]
        self._inputs = RecordedOutputs(recording, self._played)
        # The orchestrator's own subscribers do not get what it publishes (`remote`).
        publisher = partial(run.session.publisher, remote=True)
        self.player = Player(self._played, self._step_ns, run.token, publisher)

    def _comparison(self, spec: ParticipantSpec, port: str) -> PortComparison:
        topic = topic_of(spec.name, port)
        recorded = self.recording.ports.get(topic)
        return PortComparison(
            topic,
            spec.outputs[port].type,
            self._tolerance,
            self.recording.types,
            names=() if recorded is None else recorded.names,
        )

    def awaiting(self, participants: Iterable[ParticipantState]) -> None:
        """Prove the connection of those that are played, again and again."""
        if self.run.state.phase is RunPhase.START_UP:
            self.player.send_handshake()

    def ready(self) -> None:
        """Compare the descriptions of all outputs with the recorded ones."""
        for name, ports in self.comparisons.items():
            for port in ports:
                recorded = self.recording.ports.get(topic_of(name, port))
                now = self.run.descriptions.get(name, {}).get(port, Description())
                if recorded is not None and recorded.description != now:
                    what = f"describes {port} (names, units, limits) differently from the recording"
                    self.differs(name, -1, what)

    def act(self) -> None:
        """Publish the recorded outputs of all released steps; compare the outputs that came."""
        state = self.run.state
        limit = min(state.barrier.step_limit, self.at)
        for spec in self._played:
            first = max(self._fed, self._needed[spec.name])
            for step in range(-(-first // spec.every) * spec.every, limit, spec.every):
                self.player.publish(spec.name, step, self._inputs.take(spec.name, step))
        self._fed = max(self._fed, limit)
        self.run.recorder.write_below(min(state.barrier.completed, state.last_step))

    # --- comparing ------------------------------------------------------------------------

    def revise(
        self, step: int, published: Sequence[Published], closing: Collection[str] | None
    ) -> Sequence[Published]:
        """Compare the outputs of a step; return the outputs to record."""
        while self._made and self._made[0].step <= step:
            self.run.recorder.write_call(self._made.popleft())
        if step >= self.at:
            return published
        own = {item.participant: item for item in published}
        revised = list(self._revised(step, own, closing))
        self._compared = step + 1
        return revised

    def _revised(
        self, step: int, own: Mapping[str, Published], closing: Collection[str] | None
    ) -> Iterator[Published]:
        for spec in self._order:
            name = spec.name
            is_played = step < self.starts_at.get(name, 0) and step % spec.every == 0
            if is_played and (closing is None or name in closing):
                content = list(self.outputs.take(name, step).items())
                yield Published(participant=name, step=step, content=content)
            elif name in own and own[name].fault is not None:
                yield own[name]
            elif name in own:
                recorded = self.outputs.take(name, step)
                if step < self.counts_from.get(name, 0):
                    yield msgspec.structs.replace(own[name], content=list(recorded.items()))
                else:
                    self.compare_step(name, step, recorded, dict(own[name].content))
                    yield own[name]

    def compare_step(self, name: str, step: int, recorded: Ports, own: Ports) -> None:
        """Compare the outputs of a participant at a step."""
        for port, comparison in self.comparisons[name].items():
            if not comparison.take(step, recorded.get(port), own.get(port)):
                first = comparison.divergence
                what = "" if first is None else first.detail("recording", "now")
                self.differs(name, step, f"does not repeat the recording: {what}")

    def revise_call(self, call: CallRecord) -> CallRecord:
        """Compare a call that is made again; return the call to record."""
        if call.step >= self.at or not self._calls:
            return call
        recorded = self._calls.popleft()
        if call.step < self.counts_from.get(call.participant, 0):
            return recorded
        if msgspec.msgpack.encode(call) != msgspec.msgpack.encode(recorded):
            what = (
                f"answered the call {call.method} with {call.error or call.value!r}, but the "
                f"recorded answer is {recorded.error or recorded.value!r}"
            )
            self.differs(call.participant, call.step, what)
        return call

    def differs(self, name: str, step: int, what: str) -> None:
        """React to a participant that does not repeat the recording; step: −1 before the first."""


def _needed(scenario: Scenario, starts_at: Mapping[str, int]) -> dict[str, int]:
    """Return, for each participant that is read, the first step whose outputs have still to come.

    One that starts from a checkpoint has what was due before; one that never starts reads nothing.
    """
    steps: dict[str, int] = {}
    for spec in scenario.participants:
        start = starts_at.get(spec.name, 0)
        for item in spec.inputs.values() if start < FAR else ():
            every = scenario.participant(item.source).every
            due = due_step(start - spec.every, item.delay, every)
            needed = due + every if due >= 0 else 0
            steps[item.source] = min(steps.get(item.source, needed), needed)
    return steps
