"""A run that begins with the steps of a recording: they are played to it, and compared.

A branch repeats the steps below one, and is live from there on; a replay repeats all steps of one
participant, and plays the others.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

from stepbus_orchestrator.errors import Diverged, argument
from stepbus_orchestrator.recording import Recording, SavedState, layout
from stepbus_orchestrator.replay.comparison import Comparison
from stepbus_orchestrator.replay.player import Player
from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.failures import at as at_step
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.run.kernel.state import RunPhase
from stepbus_orchestrator.run.run import Run
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import CheckpointOrder
from stepbus_schemas import CallRecord

WINDOW = 256
"""How many steps participants may be apart while each repeats its own [steps]."""
_CHUNK = 1024
"""How many steps are read from the recording before those that are complete are written."""


class Repetition(RunExtension):
    """The recorded steps of a run: plays recorded outputs, and compares what comes.

    starts_at: as of `Comparison`. at: the first step that nothing is played for.
    """

    player: Player
    comparison: Comparison

    def __init__(self, recording: Recording, starts_at: Mapping[str, int], at: int = FAR) -> None:
        self.recording = recording
        self.starts_at = starts_at
        self.at = at
        self._fed = 0

    def attach(self, run: Run) -> None:
        """Let each participant start where it does."""
        super().attach(run)
        run.state.is_repeating = True
        for name, step in self.starts_at.items():
            run.state.barrier.start_at(name, step)
        self.comparison = run.recorder.reviser = self.compared()
        self.player = Player(run.session, self.comparison.outputs, self.starts_at)

    def compared(self) -> Comparison:
        """Return what compares the run with the recording."""
        raise NotImplementedError

    def awaiting(self, participants: Iterable[ParticipantState]) -> None:
        """Prove the connection of those that are played, again and again."""
        if self.run.state.phase is RunPhase.START_UP:
            self.player.send_handshake()

    def ready(self) -> None:
        """Compare how the participants describe their outputs."""
        self.comparison.check_descriptions(self.run.descriptions)

    def act(self) -> None:
        """Publish the recorded outputs of all steps that may be worked on; compare what came."""
        state = self.run.state
        complete, limit = state.barrier.completed, min(state.barrier.step_limit, self.at)
        while self._fed < limit:
            self._fed = min(self._fed + _CHUNK, limit)
            self.player.publish_below(self._fed)
            # A participant that starts at 100,000 would else keep all below it in memory.
            self.run.recorder.write_below(min(self._fed, complete, state.last_step))
        self.run.recorder.write_below(min(complete, state.last_step))


_WHY = (
    "it got its recorded inputs, so it is not deterministic, or not the program that was recorded; "
    "see docs/guide/testing/branch.md"
)
_WHY_RESTORED = (
    "it started from its checkpoint before step {step}, which does not have all of its state, or "
    "it is not the program that was recorded; branch with {without}"
)


class RecordedPrefix(Repetition):
    """The steps of a recording below `at`, as the beginning of a run.

    counts_from: participants that are not those of the recording, each with the step (at most
    `at`) from which its own outputs count; below, the recorded ones do. restored: participants that
    start from a checkpoint before a step below `at`; what is before it is taken as recorded.
    took_s: how long the run took to get to `at` [s], 0 until it is there.
    """

    is_star = True

    def __init__(
        self,
        recording: Recording,
        at: int,
        counts_from: Mapping[str, int],
        restored: Mapping[str, SavedState] = MappingProxyType({}),
    ) -> None:
        super().__init__(recording, {name: saved.step for name, saved in restored.items()}, at)
        self.counts_from = counts_from
        self.restored = restored
        self.took_s = 0.0

    def adapt(self, scenario: Scenario) -> Scenario:
        """Return the scenario without the faults that the recording has the outcome of."""
        faults = tuple(fault for fault in scenario.faults if fault.step >= self.at)
        return dataclasses.replace(scenario, faults=faults)

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """Return whose steps are those of the recording."""
        if not self.counts_from:
            return {}
        return {layout.BRANCH_METADATA: {name: str(at) for name, at in self.counts_from.items()}}

    def attach(self, run: Run) -> None:
        """Let participants be further apart, and end the run only from where they count."""
        super().attach(run)
        run.state.barrier.window = max(WINDOW, run.state.scenario.window)
        run.state.ends_from = self.counts_from

    def compared(self) -> Comparison:
        """Return what ends the run at the first difference."""
        return _Unchanged(
            self.run.recorder,
            self.recording,
            self.run.state.scenario,
            until=self.at,
            starts_at=self.starts_at,
            counts_from=self.counts_from,
        )

    def start_options(self, spec: ParticipantSpec) -> Mapping[str, Any]:
        """Return the checkpoint that a participant starts from."""
        saved = self.restored.get(spec.name)
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
        if self.comparison.reached >= self.at:
            self.player.is_live = True
            run.recorder.reviser = None
            state.is_repeating = False
            state.barrier.window = state.scenario.window
            self.took_s = run.clock.monotonic() - state.started_at
            run.timing.event("live", text=f"from step {self.at}")
        elif state.is_complete:
            raise Diverged(
                f"{state.at(state.last_step)}: {state.reason}; the recording goes on there",
                step=state.last_step,
            )


class _Unchanged(Comparison):
    """Raises Diverged with the first difference, and the participant that made it."""

    def _describes_otherwise(self, name: str, port: str) -> None:
        if name not in self._counts_from:
            raise Diverged(
                f"before the first step: {name} describes {port} (names, units, limits) not as "
                f"recorded; it is not the program that was recorded",
                participant=name,
            )

    def _differs(self, name: str, port: str, step: int, own: bytes | None) -> None:
        divergence = self._comparisons[name][port].divergence
        text = "" if divergence is None else divergence.text("recording", "now")
        why = _WHY
        if name in self._starts_at:
            without = argument("--no-checkpoints", "checkpoints=False")
            why = _WHY_RESTORED.format(without=without, step=self._starts_at[name])
        raise Diverged(
            f"{at_step(step, self._scenario.step_ns)}: {name} does not repeat the recording: "
            f"{text.removeprefix(f'step {step}: ')}; {why}",
            participant=name,
            step=step,
        )

    def _answers_otherwise(self, call: CallRecord, recorded: CallRecord) -> None:
        raise Diverged(
            f"{at_step(call.step, self._scenario.step_ns)}: {call.participant} answers the call "
            f"{call.method} with {call.error or call.value!r}, recorded is "
            f"{recorded.error or recorded.value!r}; {_WHY}",
            participant=call.participant,
            step=call.step,
        )
