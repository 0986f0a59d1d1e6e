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


class Change:
    """The scenario of a branch beside the recorded one.

    at: the first live step, by its number, or a time such as `6s`. Raises WiringError for neither.
    """

    def __init__(self, recorded: Scenario, scenario: Scenario, at: int | str) -> None:
        self.scenario = scenario
        self._recorded = recorded
        if isinstance(at, int) or at.strip().isdecimal():
            self.at = int(at)
            return
        try:
            self.at = whole_steps(at, scenario.step_ns)
        except WiringError as exc:
            raise WiringError(f"at: {exc}; or give a step number") from exc

    def check(self, recording: Recording) -> None:
        """Raise RecordingFailed or WiringError for what no branch of a recording can be."""
        self._check_wiring()
        self._check_step(recording)
        at, scenario = self.at, self.scenario
        if scenario.steps is not None and at > scenario.steps:
            raise WiringError(
                f"duration: the branch would end at step {scenario.steps}, before step {at}"
            )
        for fault in scenario.faults:
            if fault.step < at and fault not in self._recorded.faults:
                raise WiringError(
                    f"the fault '{format_fault(fault)}' is before step {at}, where the branch is "
                    "live"
                )

    def participants(self) -> list[str]:
        """Return the participants that are not those of the recording."""
        pairs = [(now, self._recorded.participant(now.name)) for now in self.scenario.participants]
        return [
            now.name
            for now, was in pairs
            if any(getattr(now, key) != getattr(was, key) for key in PROGRAM)
        ]

    def _check_wiring(self) -> None:
        """Raise WiringError for a change of what decides who reads what at which step."""
        was, now = self._recorded, self.scenario
        names = [spec.name for spec in was.participants]
        is_same = names == [spec.name for spec in now.participants]
        if changed := rewired(was, now, names) if is_same else ["participants"]:
            raise WiringError(
                f"{', '.join(changed)}: a branch cannot change step, seed, ports or "
                "rates; it can change parameters, programs, deadlines, duration, window "
                "and bus"
            )

    def _check_step(self, recording: Recording) -> None:
        """Raise RecordingFailed where the recording does not have all that is below a step."""
        check_whole(recording, self._recorded, [s.name for s in self._recorded.participants])
        end, at = recorded_end(recording), self.at
        planned, has_failed = self._recorded.steps, layout.INCOMPLETE_METADATA in recording.metadata
        if recording.cut_short or has_failed or planned is None or end < planned:
            # Where a run fails, some participants are ahead of others.
            names = (spec.name for spec in self._recorded.participants)
            end = min(replayable_steps(recording, self._recorded, name) for name in names)
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

    def call(self, text: str) -> CallRecord:
        """Return the call before `at` that a text such as `controller set kp 90` stands for."""
        words = shlex.split(text)
        given = f"--call {text}"
        if len(words) < 2:
            raise WiringError(f"{given}: write PARTICIPANT METHOD ARG…")
        name, method, *values = words
        names = [spec.name for spec in self.scenario.participants]
        if name not in names:
            raise WiringError(f"{given}: no participant {name!r}{suggest(name, names)}")
        args = [parse_yaml(value, value) for value in values]
        return CallRecord(step=self.at, participant=name, method=method, args=args)


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
