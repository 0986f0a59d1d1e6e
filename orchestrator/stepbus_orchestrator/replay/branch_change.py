"""What a branch changes, from which step on, and in which variants."""

import itertools
import json
import re
import shlex
from collections.abc import Sequence

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording, layout
from stepbus_orchestrator.replay.recorded import (
    PROGRAM,
    check_whole,
    recorded_end,
    replayable_steps,
    rewired,
)
from stepbus_orchestrator.scenario.fault_texts import format_fault
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_participant import suggest, whole_steps
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import CallRecord, WiringError


def first_live_step(at: int | str, step_ns: int) -> int:
    """Return the step of its number, or of a time such as `6s`; raises WiringError for neither."""
    if isinstance(at, int) or at.strip().isdecimal():
        return int(at)
    try:
        return whole_steps(at, step_ns)
    except WiringError as exc:
        raise WiringError(f"at: {exc}; or give a step number") from exc


def check_change(was: Scenario, now: Scenario, at: int, recording: Recording) -> None:
    """Raise RecordingFailed or WiringError for what no branch of a recording can be.

    was, now: the recorded scenario, and that of the branch. at: the first live step.
    """
    names = [spec.name for spec in was.participants]
    is_same = names == [spec.name for spec in now.participants]
    if changed := rewired(was, now, names) if is_same else ["participants"]:
        raise WiringError(
            f"{', '.join(changed)}: a branch cannot change step, seed, ports or "
            "rates; it can change parameters, programs, deadlines, duration, window "
            "and bus"
        )
    _check_step(was, at, recording)
    if now.steps is not None and at > now.steps:
        raise WiringError(f"duration: the branch would end at step {now.steps}, before step {at}")
    for fault in now.faults:
        if fault.step < at and fault not in was.faults:
            raise WiringError(
                f"the fault '{format_fault(fault)}' is before step {at}, where the branch is live"
            )


def _check_step(was: Scenario, at: int, recording: Recording) -> None:
    """Raise RecordingFailed where the recording does not have all that is below a step."""
    names = [spec.name for spec in was.participants]
    check_whole(recording, was, names)
    end, has_failed = recorded_end(recording), layout.INCOMPLETE_METADATA in recording.metadata
    if recording.cut_short or has_failed or was.steps is None or end < was.steps:
        # Where a run fails, some participants are ahead of others.
        end = min(replayable_steps(recording, was, name) for name in names)
    if not 0 <= at <= end:
        raise RecordingFailed(
            f"step {at} is past the end of {recording.path} ({end} complete steps)"
        )
    first = recording.steps_in(layout.FALLBACK_METADATA).get("first")
    if first is not None and at > first:
        who = recording.metadata[layout.FALLBACK_METADATA].get("participant", "a participant")
        raise RecordingFailed(
            f"{recording.path}: {who} failed and was replaced from step {first} on; "
            "branch at that step or earlier"
        )
    latest = max(recording.steps_in(layout.BRANCH_METADATA).values(), default=0)
    if at < latest:
        raise RecordingFailed(
            f"{recording.path} is a branch from step {latest}: branch at that step "
            "or later, or branch the original recording"
        )


def changed_participants(was: Scenario, now: Scenario) -> list[str]:
    """Return the participants that are not those of the recorded scenario."""
    pairs = [(spec, was.participant(spec.name)) for spec in now.participants]
    return [
        spec.name
        for spec, old in pairs
        if any(getattr(spec, key) != getattr(old, key) for key in PROGRAM)
    ]


def call_before(at: int, text: str, scenario: Scenario) -> CallRecord:
    """Return the call before a step that a text such as `controller set kp 90` stands for."""
    words = shlex.split(text)
    given = f"--call {text}"
    if len(words) < 2:
        raise WiringError(f"{given}: write PARTICIPANT METHOD ARG…")
    name, method, *values = words
    names = [spec.name for spec in scenario.participants]
    if name not in names:
        raise WiringError(f"{given}: no participant {name!r}{suggest(name, names)}")
    args = [parse_yaml(value, value) for value in values]
    return CallRecord(step=at, participant=name, method=method, args=args)


_LEADING = re.compile(r"^[^=]*\.")


def variants(texts: Sequence[str]) -> dict[str, list[str]]:
    """Return the variants of texts such as `controller.params.kp=50,100,200`, in all combinations.

    Each has a name, `kp=50` or `kp=50, kd=2`, and its overrides. Raises WiringError for a text
    without values.
    """
    rows = [_overrides(text) for text in texts]
    return {
        ", ".join(_LEADING.sub("", override) for override in chosen): list(chosen)
        for chosen in itertools.product(*rows)
    }


def _overrides(text: str) -> list[str]:
    path, _, values = text.partition("=")
    # As YAML has a list, so that a value may be one itself.
    parsed = parse_yaml(text, f"[{values}]") if path.strip() and values.strip() else []
    if not parsed:
        raise WiringError(
            f"--vary {text!r}: write PATH=VALUE,VALUE…, e.g. controller.params.kp=50,100"
        )
    return [f"{path.strip()}={json.dumps(value, ensure_ascii=False)}" for value in parsed]
