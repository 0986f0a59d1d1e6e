"""Counts what a replayed participant publishes otherwise than recorded."""

from stepbus_orchestrator.analysis.divergence import Divergence, PortResult
from stepbus_orchestrator.analysis.tolerance import Tolerance
from stepbus_orchestrator.errors import ParticipantFault
from stepbus_orchestrator.recording import Recording, Sink
from stepbus_orchestrator.replay.comparison import Comparison
from stepbus_orchestrator.replay.recorded import Ports, counts_from_of
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.failures import at
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_schemas import CallRecord, MessageError


class Check(Comparison):
    """Counts what one participant publishes otherwise than recorded, beyond a tolerance.

    Raises ParticipantFault for a message that is not of its port's type. notes: what else differs.
    """

    def __init__(
        self,
        sink: Sink,
        recording: Recording,
        scenario: Scenario,
        participant: str,
        tolerance: Tolerance,
    ) -> None:
        counts_from = counts_from_of(recording).get(participant, 0)
        super().__init__(
            sink,
            recording,
            scenario,
            starts_at=all_but(participant, scenario),
            counts_from={participant: counts_from},
            tolerance=tolerance,
        )
        self.notes: list[str] = []
        self._spec = scenario.participant(participant)
        self._ports = self._comparisons[participant]
        self._next = 0
        if counts_from:
            self.notes.append(
                f"the recording is a branch: {participant} was changed at step {counts_from}, "
                "and is compared from there on"
            )

    def _describes_otherwise(self, name: str, port: str) -> None:
        self.notes.append(f"{name}/{port}: its description (names, units, limits) has changed")

    def _differs(self, name: str, port: str, step: int, own: bytes | None) -> None:
        if own is None:
            return
        try:
            self._ports[port].decode(own)
        except MessageError as exc:
            raise ParticipantFault(
                f"{at(step, self._scenario.step_ns)}: {name}.{port} is {exc}",
                participant=name,
                step=step,
            ) from exc

    def _answers_otherwise(self, call: CallRecord, recorded: CallRecord) -> None:
        """Do nothing: a replay compares messages."""

    def miss_below(self, end: int) -> None:
        """Count all recorded outputs of steps below `end` that did not come as missing."""
        name, every = self._spec.name, self._spec.every
        first = max(self._next, -(-self._counts_from[name] // every) * every)
        for step in range(first, end, every):
            self._compare(name, step, self.outputs.take(name, step), {})

    def _compare(self, name: str, step: int, recorded: Ports, own: Ports) -> None:
        super()._compare(name, step, recorded, own)
        self._next = step + self._spec.every

    @property
    def divergence(self) -> Divergence | None:
        """Return the first divergence, in the order of the ports within a step."""
        divergences = (one.divergence for one in self._ports.values())
        return min((item for item in divergences if item), key=lambda item: item.step, default=None)

    def results(self) -> list[PortResult]:
        """Return what has become of each port."""
        return [one.result() for one in self._ports.values()]


def all_but(participant: str, scenario: Scenario) -> dict[str, int]:
    """Return when the participants of a replay start: all but one never do."""
    return {spec.name: FAR for spec in scenario.participants if spec.name != participant}
