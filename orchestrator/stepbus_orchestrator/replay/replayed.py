"""All steps of a recording, in which one participant is started and all others are played."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from stepbus_orchestrator.analysis.divergence import Divergence, PortResult
from stepbus_orchestrator.analysis.tolerance import Tolerance
from stepbus_orchestrator.errors import ParticipantFault
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.recorded import Ports, counts_from_of, recorded_descriptions
from stepbus_orchestrator.replay.repetition import Repetition
from stepbus_orchestrator.run.extension import RunView
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.run.kernel.state import at
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_schemas import Decoder, MessageError, Outputs

_decode_outputs = Decoder(Outputs)


class Replayed(Repetition):
    """Counts what one participant publishes otherwise than recorded, beyond a tolerance.

    folder: where it is started; None: in the folder of the scenario. notes: what else differs.

    Raises ParticipantFault for a message that is not of its port's type.
    """

    def __init__(
        self,
        recording: Recording,
        scenario: Scenario,
        participant: str,
        tolerance: Tolerance,
        folder: Path | None = None,
    ) -> None:
        others = (spec.name for spec in scenario.participants if spec.name != participant)
        changed = counts_from_of(recording).get(participant, 0)
        super().__init__(
            recording,
            starts_at=dict.fromkeys(others, FAR),
            counts_from={participant: changed},
            tolerance=tolerance,
        )
        self.spec = scenario.participant(participant)
        self.notes: list[str] = []
        if changed:
            self.notes.append(
                f"the recording is a branch: {participant} was changed at step {changed}, "
                "and is compared from there on"
            )
        self.notes += [
            f"{participant}/{port} is compared where it is recorded (`record: {output.record}`)"
            for port, output in self.spec.outputs.items()
            if output.record_every != 1
        ]
        self._folder = folder
        self._next = changed
        self._newest = b""

    def attach(self, run: RunView) -> None:
        """Give the run the recorded descriptions, and watch the participant."""
        super().attach(run)
        run.descriptions = recorded_descriptions(self.recording)
        # No participant waits for it: only its outputs themselves show how far it has come.
        see = partial(setattr, self, "_newest")
        run.session.bus.subscribe_content(f"out/{self.spec.name}", see)

    def start_options(self, spec: ParticipantSpec) -> Mapping[str, Any]:
        """Return where the participant is started."""
        return {} if self._folder is None else {"folder": self._folder}

    def started(self, participant: ParticipantState) -> None:
        """Watch which step the participant publishes: its failures name it."""
        participant.newest = self._newest_step

    def _newest_step(self) -> int:
        try:
            return _decode_outputs(self._newest).step if self._newest else -1
        except MessageError:
            return -1

    def describes_otherwise(self, name: str, port: str) -> None:
        """Note it."""
        self.notes.append(f"{name}/{port}: its description (names, units, limits) has changed")

    def compare_step(self, name: str, step: int, recorded: Ports, own: Ports) -> None:
        """Compare what the participant has published at a step."""
        super().compare_step(name, step, recorded, own)
        self._next = step + self.spec.every

    def differs(self, name: str, port: str, step: int, own: bytes | None) -> None:
        """Raise ParticipantFault where the message is not of its port's type."""
        try:
            if own is not None:
                self.comparisons[name][port].decode(own)
        except MessageError as exc:
            raise ParticipantFault(
                f"{at(step, self._step_ns)}: {name}.{port} is {exc}", participant=name, step=step
            ) from exc

    def miss_below(self, end: int) -> None:
        """Count all recorded outputs of steps below `end` that did not come as missing."""
        name, every = self.spec.name, self.spec.every
        for step in range(-(-self._next // every) * every, end, every):
            self.compare_step(name, step, self.outputs.take(name, step), {})

    @property
    def divergence(self) -> Divergence | None:
        """Return the first divergence, in the order of the ports within a step."""
        divergences = (result.divergence for result in self.results())
        return min((item for item in divergences if item), key=lambda item: item.step, default=None)

    def results(self) -> list[PortResult]:
        """Return what has become of each port."""
        return [one.result() for one in self.comparisons[self.spec.name].values()]
