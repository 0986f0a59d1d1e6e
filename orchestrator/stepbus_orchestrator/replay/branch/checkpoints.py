"""Which checkpoints a branch starts from."""

from collections.abc import Mapping, Sequence

from stepbus_orchestrator.recording import Checkpoints, SavedState
from stepbus_orchestrator.scenario import ParticipantSpec
from stepbus_schemas import CallRecord

from .plan import Plan


def choose(saved: Checkpoints, plan: Plan) -> Mapping[str, SavedState]:
    """Return the newest checkpoint of each participant that the branch does not change.

    It is before a step below that of the branch: so at least one step of the participant is
    compared with the recording.
    """
    unchanged = [spec for spec in plan.scenario.participants if spec.name not in plan.changed]
    found = {spec.name: _newest(saved, spec, plan) for spec in unchanged}
    return {name: checkpoint for name, checkpoint in found.items() if checkpoint is not None}


def _newest(saved: Checkpoints, spec: ParticipantSpec, plan: Plan) -> SavedState | None:
    called = [call.step for call in plan.calls if call.participant == spec.name]
    for checkpoint in saved.below(spec.name, plan.at):
        fits = checkpoint.step % spec.every == 0
        # A participant answers calls while it waits for its own next step, behind the checkpoint.
        splits = any(checkpoint.step - spec.every < step < checkpoint.step for step in called)
        if fits and not splits:
            return checkpoint
    return None


def to_be_made(calls: Sequence[CallRecord], restored: Mapping[str, SavedState]) -> list[CallRecord]:
    """Return the calls of a recording that are in no checkpoint."""
    return [
        call
        for call in calls
        if call.participant not in restored or call.step >= restored[call.participant].step
    ]
