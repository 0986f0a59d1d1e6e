"""Which checkpoints a branch starts from."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from stepbus_orchestrator.errors import OutputExists, RecordingFailed, argument
from stepbus_orchestrator.recording import Checkpoints, Recording, SavedState, layout
from stepbus_orchestrator.replay.recorded import counts_from_of, replayable_steps
from stepbus_orchestrator.replay.rerun import (
    SOURCE_FOLDER,
    Origin,
    origin_of,
    refuse_others,
    unpack,
    version_notes,
)
from stepbus_orchestrator.run.result import own_versions
from stepbus_orchestrator.scenario.faults import format_fault
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import suggest, whole_steps
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import CallRecord, WiringError


def to_be_made(calls: Sequence[CallRecord], restored: Mapping[str, SavedState]) -> list[CallRecord]:
    """Return the calls of a recording that are in no checkpoint."""
    return [
        call
        for call in calls
        if call.participant not in restored or call.step >= restored[call.participant].step
    ]


_KEPT = ("every", "publishes", "inputs", "outputs")
"""They decide who reads what at which step: a branch keeps them."""
_CHANGEABLE = ("participant", "exec", "bridge", "params")


@dataclass(frozen=True, kw_only=True)
class Change:
    """What is not as in the recording; see `BranchPlan`."""

    overrides: Sequence[str] = ()
    faults: Sequence[str] = ()
    calls: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What a branch runs.

    at: the first live step. counts_from: as of `RecordedPrefix`; changed: those that this branch
    has changed. calls: of the recording; new_calls: of this branch.
    """

    scenario: Scenario
    at: int
    counts_from: Mapping[str, int]
    changed: Sequence[str]
    calls: Sequence[CallRecord]
    new_calls: Sequence[CallRecord]
    notes: list[str]


def plan(
    recording: Recording, at: int | str, out: Path, change: Change, trusted: str | None
) -> Plan:
    """Unpack a recording's scenario into `out/source`, and check that it can be branched."""
    origin = origin_of(recording)
    refuse_others(origin, trusted)
    if (out / "logs").exists() or (out / SOURCE_FOLDER).exists():
        raise OutputExists(f"{out} holds a run already; choose another {argument('--out')}")
    path = unpack(origin, out / SOURCE_FOLDER)
    recorded = load(path)
    scenario = load(path, change.overrides, change.faults)
    _check_wiring(recorded, scenario)
    step = _step(at, scenario.step_ns)
    _check_step(recording, origin, recorded, step)
    if scenario.steps is not None and step > scenario.steps:
        raise WiringError(f"duration: the branch would end at step {scenario.steps}, before {step}")
    _check_faults(recorded, scenario, step)
    changed = [
        spec.name
        for spec in scenario.participants
        if any(
            getattr(spec, key) != getattr(recorded.participant(spec.name), key)
            for key in _CHANGEABLE
        )
    ]
    counts_from = {**counts_from_of(recording), **dict.fromkeys(changed, step)}
    ran_on = origin.versions.get(layout.ORCHESTRATOR, {})
    return Plan(
        scenario=scenario,
        at=step,
        # In the order of the scenario: it is recorded.
        counts_from={
            spec.name: counts_from[spec.name]
            for spec in scenario.participants
            if counts_from.get(spec.name)
        },
        changed=changed,
        calls=origin.calls,
        new_calls=[_call(text, step, scenario) for text in change.calls],
        notes=version_notes("the orchestrator", ran_on, own_versions()),
    )


def _step(at: int | str, step_ns: int) -> int:
    """Return the step of a number, or of a time such as `6s`; raises WiringError for neither."""
    if isinstance(at, int) or at.strip().isdecimal():
        return int(at)
    try:
        return whole_steps(at, step_ns)
    except WiringError as exc:
        raise WiringError(f"at: {exc}; or give the number of a step") from exc


def _check_step(recording: Recording, origin: Origin, scenario: Scenario, at: int) -> None:
    """Raise RecordingFailed where the recording does not have all that is below a step."""
    holes = recording.holes()
    if holes:
        raise RecordingFailed(f"{recording.path} has a hole: {'; '.join(holes)}")
    end = origin.end
    if recording.cut_short:
        names = (spec.name for spec in scenario.participants)
        end = min(replayable_steps(recording, scenario, name) for name in names)
    if not 0 <= at <= end:
        raise RecordingFailed(f"{recording.path} has {end} complete steps; none is step {at}")
    held = recording.metadata.get(layout.FALLBACK_METADATA)
    if held is not None and at > int(held["first"]):
        raise RecordingFailed(
            f"{recording.path}: {held['participant']} had failed and was replaced from step "
            f"{held['first']} on; branch there or before"
        )
    latest = max(counts_from_of(recording).values(), default=0)
    if at < latest:
        raise RecordingFailed(
            f"{recording.path} is a branch from step {latest}: branch it there or later, or branch "
            "the recording that it was made from"
        )


def _check_wiring(recorded: Scenario, scenario: Scenario) -> None:
    """Raise WiringError for a change of what decides who reads what at which step."""
    rows = {
        "step": (recorded.step_ns, scenario.step_ns),
        "seed": (recorded.seed, scenario.seed),
        "participants": (
            [spec.name for spec in recorded.participants],
            [spec.name for spec in scenario.participants],
        ),
    }
    changed = [key for key, (was, now) in rows.items() if was != now]
    if "participants" not in changed:
        changed += [
            f"{spec.name}.{key}"
            for spec in scenario.participants
            for key in _KEPT
            if getattr(spec, key) != getattr(recorded.participant(spec.name), key)
        ]
    if changed:
        raise WiringError(
            f"{', '.join(changed)}: a branch keeps step, seed, ports and rates of the recording; "
            "change parameters, programs, deadlines, duration, window or bus"
        )


def _check_faults(recorded: Scenario, scenario: Scenario, at: int) -> None:
    early = [f for f in scenario.faults if f.step < at and f not in recorded.faults]
    if early:
        raise WiringError(
            f"the fault '{format_fault(early[0])}' is before step {at}, where the branch is live"
        )


def _call(text: str, at: int, scenario: Scenario) -> CallRecord:
    """Return the call that a text such as `controller set kp 90` stands for."""
    words = shlex.split(text)
    if len(words) < 2:
        raise WiringError(f"{argument('--call', 'calls', text)}: write PARTICIPANT METHOD ARG…")
    name, method, *values = words
    names = [spec.name for spec in scenario.participants]
    if name not in names:
        raise WiringError(
            f"{argument('--call', 'calls', text)}: no participant {name!r}{suggest(name, names)}"
        )
    args = [parse_yaml(value, value) for value in values]
    return CallRecord(step=at, participant=name, method=method, args=args)


def choose(saved: Checkpoints, plan: Plan) -> Mapping[str, SavedState]:
    """Return the newest checkpoint of each participant that the branch does not change.

    It is before a step below that of the branch: so at least one step of the participant is
    compared with the recording.
    """
    unchanged = [spec for spec in plan.scenario.participants if spec.name not in plan.changed]
    chosen = {spec.name: _newest(saved, spec, plan) for spec in unchanged}
    return {name: checkpoint for name, checkpoint in chosen.items() if checkpoint is not None}


def _newest(saved: Checkpoints, spec: ParticipantSpec, plan: Plan) -> SavedState | None:
    called = [call.step for call in plan.calls if call.participant == spec.name]
    for checkpoint in saved.below(spec.name, plan.at):
        fits = checkpoint.step % spec.every == 0
        # A participant answers calls while it waits for its own next step, behind the checkpoint.
        splits = any(checkpoint.step - spec.every < step < checkpoint.step for step in called)
        if fits and not splits:
            return checkpoint
    return None
