"""Keeps the states that participants save, beside the recording (P16)."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from stepbus_orchestrator.recording import CheckpointWriter
from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_participant import CheckpointOrder, Sample, read_stamp

if TYPE_CHECKING:
    from stepbus_orchestrator.run.result import Result


class SaveCheckpoints(RunExtension):
    """Asks participants for their states every so many steps of the scenario, and keeps them."""

    def __init__(self) -> None:
        self._writer: CheckpointWriter | None = None

    def attach(self, run: RunView) -> None:
        """Listen to states."""
        super().attach(run)
        self._writer = CheckpointWriter(run.out)
        run.session.bus.subscribe("checkpoint/*", run.session.inbox.into(self._take))

    def start_options(self, spec: ParticipantSpec) -> Mapping[str, Any]:
        """Return how often a participant saves its state."""
        every = self.run.state.scenario.checkpoint_steps
        return {"checkpoint": CheckpointOrder(every=every)}

    def _take(self, sample: Sample) -> None:
        state = self.run.state
        name = sample.key.rpartition("/")[2]
        step = read_stamp(sample.attachment, self.run.session.token)
        if step is None or name not in state.participants:
            state.unauthenticated += 1
        elif self._writer is not None and step > 0 and name != state.replaced:
            self._writer.add(name, step, sample.payload)

    def finish(self, result: "Result") -> None:
        """Bind the states to the recording; without, they are of no use, and no more."""
        if self._writer is not None:
            self._writer.finish(result.sha256)
