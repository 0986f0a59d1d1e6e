"""Publishes what a recording has of participants, for those that read them; then what they do.

Participants are linked to the orchestrator only. So each gets its recorded inputs, ahead and
whatever the others do; and from the first live step on, what its sources publish, passed on as it
is. For the participants nothing changes: the same keys, the same messages, the same processes.
"""

from collections.abc import Callable, Mapping
from functools import partial

from stepbus_orchestrator.replay.recorded import Ports, RecordedOutputs, outputs_of
from stepbus_orchestrator.run.bus import Session
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import Sample, stamp
from stepbus_schemas import HANDSHAKE_STEP, due_step, encode

_Put = Callable[..., None]


class Player:
    """Publishes for every participant that is read: recorded outputs, and once it is live, its own.

    starts_at: participants that start behind step 0, or at `FAR` and thus never, each with its
    step. is_live: whether what participants publish is passed on.
    """

    def __init__(
        self, session: Session, recorded: RecordedOutputs, starts_at: Mapping[str, int]
    ) -> None:
        self.is_live = False
        self._session = session
        self._recorded = recorded
        self._needed = _needed(session.scenario, starts_at)
        self._sources = [s for s in session.scenario.participants if s.name in self._needed]
        self._puts: dict[str, _Put] = {}
        self._bulk_puts: dict[str, dict[str, _Put]] = {}
        for spec in self._sources:
            self._open(spec)

    def _open(self, spec: ParticipantSpec) -> None:
        bus, into = self._session.bus, self._session.inbox.into
        # The orchestrator's own subscribers do not get what it publishes (`remote`).
        publisher = partial(self._session.announcer.publisher, remote=True)
        key = f"out/{spec.name}"
        put = self._puts[spec.name] = publisher(key, "Outputs/1")
        bulk = {port: f"bulk/{spec.name}/{port}" for port, o in spec.outputs.items() if o.bulk}
        puts = {port: publisher(bulk[port], spec.outputs[port].type) for port in bulk}
        self._bulk_puts[spec.name] = puts
        for port, bulk_key in bulk.items():
            bus.subscribe(bulk_key, into(partial(self._pass_bulk_on, puts[port])))
        bus.subscribe_content(key, into(partial(self._pass_on, put)))

    def _pass_on(self, put: _Put, outputs: bytes) -> None:
        """Pass on what a participant published; before, the recording has spoken for it.

        Its outputs come before the log that reports them, on the same link: none of the recorded
        steps comes after the last of these.
        """
        if self.is_live:
            put(outputs)

    def _pass_bulk_on(self, put: _Put, sample: Sample) -> None:
        if self.is_live:
            put(sample.payload, attachment=sample.attachment)

    def send_handshake(self) -> None:
        """Prove the connection for each source, before the first step."""
        for spec in self._sources:
            self._publish(spec, HANDSHAKE_STEP, {})
            for put in self._bulk_puts[spec.name].values():
                put(b"", attachment=stamp(HANDSHAKE_STEP, self._session.token))

    def publish_below(self, step: int) -> None:
        """Publish all recorded outputs of steps below `step` that any participant has to get."""
        for spec in self._sources:
            for recorded_step, ports in self._recorded.ahead(spec.name, step):
                if recorded_step >= self._needed[spec.name]:
                    self._publish(spec, recorded_step, ports)

    def _publish(self, spec: ParticipantSpec, step: int, ports: Ports) -> None:
        """Publish the outputs of a step, bulk content first."""
        token, bulk_puts = self._session.token, self._bulk_puts[spec.name]
        step_ns = self._session.scenario.step_ns if step >= 0 else 0
        outputs, bulk = outputs_of(step, ports, bulk_puts, token=token, step_ns=step_ns)
        for port, data in bulk.items():
            bulk_puts[port](data, attachment=stamp(step, token))
        self._puts[spec.name](encode(outputs))


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
