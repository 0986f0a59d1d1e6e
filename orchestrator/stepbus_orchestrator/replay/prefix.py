"""The beginning of a branch: all participants repeat what is recorded below a step."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from stepbus_orchestrator.errors import Diverged
from stepbus_orchestrator.recording import Recording, SavedState, layout
from stepbus_orchestrator.replay.repetition import Repetition
from stepbus_orchestrator.run.extension import RunView
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.state import at as at_step
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import CheckpointOrder

WINDOW = 256
"""How many steps participants may be apart while each repeats its own [steps]."""
_WHY = (
    "it received its recorded inputs, so either it is not deterministic or it is not the "
    "recorded program; see docs/guide/testing/branch.md"
)
_WHY_RESTORED = (
    "it started from its checkpoint before step {step}; either the checkpoint lacks some "
    "of its state, or it is not the recorded program; branch with --no-checkpoints"
)


class RecordedPrefix(Repetition):
    """The steps of a recording below `at`, as the beginning of a run.

    restored: participants that start from a checkpoint before a step below `at`. took_s: how long
    the run took to get to `at` [s], 0 until it is there.

    Raises Diverged with the first difference, and the participant that made it.
    """

    def __init__(
        self,
        recording: Recording,
        at: int,
        counts_from: Mapping[str, int],
        restored: Mapping[str, SavedState] = MappingProxyType({}),
    ) -> None:
        starts_at = {name: saved.step for name, saved in restored.items()}
        super().__init__(recording, at=at, starts_at=starts_at, counts_from=counts_from)
        self._restored = restored
        self.took_s = 0.0

    def adapt(self, scenario: Scenario) -> Scenario:
        """Return the scenario without the faults that the recording has the outcome of."""
        faults = tuple(fault for fault in scenario.faults if fault.step >= self.at)
        return dataclasses.replace(scenario, faults=faults)

    def attach(self, run: RunView) -> None:
        """Widen the window; a changed participant may end the run from where it counts."""
        super().attach(run)
        if self.counts_from:
            steps = {name: str(at) for name, at in self.counts_from.items()}
            run.recorder.add_metadata(layout.BRANCH_METADATA, steps)
        run.state.barrier.window = max(WINDOW, run.state.scenario.window)
        run.state.ends_from = self.counts_from

    def start_options(self, spec: ParticipantSpec) -> Mapping[str, Any]:
        """Return the checkpoint that a participant starts from."""
        saved = self._restored.get(spec.name)
        if saved is None:
            return {}
        every = self.run.state.scenario.checkpoint_steps
        order = CheckpointOrder(every=every, step=saved.step, state=str(saved.path))
        return {"checkpoint": order}

    def limit(self, released: int) -> int:
        """Return the first live step, until all have repeated what is below."""
        return FAR if self.player.is_live else self.at

    def act(self) -> None:
        """Publish what is recorded below `at`; be live once all is repeated.

        Raises Diverged where the run ends in what is recorded.
        """
        run, state = self.run, self.run.state
        if self.player.is_live:
            return
        super().act()
        if self._compared >= self.at:
            self.player.is_live = True
            run.recorder.reviser = None
            state.is_repeating = False
            state.barrier.window = state.scenario.window
            self.took_s = run.clock.monotonic() - state.started_at
            run.timing.event("live", text=f"from step {self.at}")
        elif state.is_complete:
            raise Diverged(
                (
                    f"{state.at(state.last_step)}: {state.reason}; the recording continues "
                    "after that"
                ),
                step=state.last_step,
            )

    def differs(self, name: str, step: int, what: str) -> None:
        """Raise Diverged, with what may be the cause; a changed participant may say otherwise."""
        if step < 0 and name in self.counts_from:
            return
        why = _WHY
        if name in self.starts_at:
            why = _WHY_RESTORED.format(step=self.starts_at[name])
        when = at_step(step, self._step_ns)
        raise Diverged(f"{when}: {name} {what}; {why}", participant=name, step=step)
