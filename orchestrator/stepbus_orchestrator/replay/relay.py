"""Between all participants of a branch: first the recording speaks for them, then they do.

Participants are linked to the orchestrator only. So each gets its recorded inputs, ahead and
whatever the others do; and from the first live step on, what its sources publish, passed on as it
is. For the participants nothing changes: the same keys, the same messages, the same processes.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from functools import partial
from typing import Any

from stepbus_orchestrator.errors import Diverged
from stepbus_orchestrator.replay.peers import Speaker
from stepbus_orchestrator.replay.recorded import envelope
from stepbus_orchestrator.replay.sink import Expected, PrefixSink
from stepbus_orchestrator.run.bus import Session
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_orchestrator.scenario import Scenario
from stepbus_participant import Bus
from stepbus_schemas import due_step

_CHUNK = 1024
"""How many steps are read from the recording before those that are complete are written."""

_Put = Callable[..., None]


class Relay:
    """Publishes for every participant that is a source: recorded outputs below `at`, then its own.

    Peers of a strategy and gate of a run: nobody is let into step `at` before all have repeated
    what is below. sink: compares it. restored: participants that start from a checkpoint, each with
    its step. on_live: called when all are there.
    """

    names: Collection[str] = ()
    """Nobody is replaced: everybody takes part."""

    def __init__(
        self,
        session: Session,
        expected: Expected,
        sink: PrefixSink,
        *,
        at: int,
        restored: Mapping[str, int],
        on_live: Callable[[], None],
    ) -> None:
        self.state: RunState | None = None
        self._token = session.token
        self._step_ns = session.scenario.step_ns
        self._expected = expected
        self._at = at
        self._sink = sink
        self._restored = restored
        self._needed = _needed(session.scenario, restored)
        self._on_live = on_live
        self._is_live = False
        self._fed = 0
        self._speakers = _speakers(session)
        bus, into = session.bus, session.inbox.into
        for speaker in self._speakers:
            for key, put in speaker.bulk_puts():
                bus.subscribe(key, into(partial(self._pass_bulk_on, bus, put)))
            if speaker.put is not None:
                bus.subscribe_content(speaker.key, into(partial(self._pass_on, speaker.put)))

    def _pass_on(self, put: _Put, outputs: bytes) -> None:
        """Pass on what a participant published; below `at`, the recording has spoken for it.

        Its outputs come before the log that reports them, on the same link: none of the prefix
        comes after the last of these.
        """
        if self._is_live:
            put(outputs)

    def _pass_bulk_on(self, bus: Bus, put: _Put, sample: Any) -> None:
        if self._is_live:
            put(bus.payload(sample), attachment=bus.attachment(sample))

    def limit(self, _released: int) -> int:
        """Return the first live step, until all have repeated what is below."""
        return FAR if self._is_live else self._at

    def send_handshake(self) -> None:
        """Prove the connection for each source."""
        for speaker in self._speakers:
            speaker.send_handshake(self._token)

    def publish_below(self, step: int, reported: dict[str, int]) -> None:
        """Publish the recorded outputs of steps below `step`; be live once all are repeated."""
        if self._is_live:
            return
        for first in range(min(self._fed, step), step, _CHUNK):
            self._publish_below(min(first + _CHUNK, step))
        self._fed = max(self._fed, step)
        state = self.state
        if state is not None and state.barrier.completed >= self._at and self._sink.is_compared():
            self._is_live = True
            state.is_repeating = False
            state.barrier.window = state.scenario.window
            self._on_live()

    def _publish_below(self, step: int) -> None:
        for speaker in self._speakers:
            name = speaker.name
            for fed, ports in self._expected.below(name, step):
                outputs = envelope(self._token, fed, self._step_ns, ports)
                if fed >= self._needed[name]:
                    speaker.publish(outputs)
                if fed < self._restored.get(name, 0):
                    self._sink.offer_as_recorded(name, outputs)
        if self.state is not None and self._restored:
            # A participant that starts at 100,000 would else keep all below it in memory.
            self._sink.write_below(min(step, self.state.barrier.completed))

    def close(self, step: int, names: Iterable[str], reported: dict[str, int]) -> None:
        """Raise Diverged where the run ends in what is recorded."""
        if not self._is_live and step < self._at and self.state is not None:
            raise Diverged(
                f"{self.state.at(step)}: {self.state.reason}; the recording goes on there",
                step=step,
            )


def _needed(scenario: Scenario, restored: Mapping[str, int]) -> dict[str, int]:
    """Return, for each participant, the first step whose outputs any other has still to get.

    One that starts from a checkpoint has what was due before.
    """
    steps = {spec.name: FAR for spec in scenario.participants}
    for spec in scenario.participants:
        last = restored.get(spec.name, 0) - spec.every
        for item in spec.inputs.values():
            every = scenario.participant(item.source).every
            due = due_step(last, item.delay, every)
            taken = due if due >= 0 else -every
            steps[item.source] = min(steps[item.source], taken + every)
    return steps


def _speakers(session: Session) -> list[Speaker]:
    """Return one for each participant; who has no consumers publishes to nobody."""
    specs = session.scenario.participants
    sources = {item.source for spec in specs for item in spec.inputs.values()}
    return [
        Speaker(spec, session.announcer, is_read=spec.name in sources, remote=True)
        for spec in specs
    ]
