"""A branch: a recording up to a step, and from there on a live run, with a change."""

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

from stepbus_orchestrator.recording import Checkpoints, Recording, SavedState, layout
from stepbus_orchestrator.recording.layout import Source, recording_file
from stepbus_orchestrator.replay.branch_change import (
    call_before,
    changed_participants,
    check_change,
    first_live_step,
)
from stepbus_orchestrator.replay.prefix import RecordedPrefix
from stepbus_orchestrator.replay.rerun import Repeated
from stepbus_orchestrator.replay.sources import Sources, own_version_notes, unpack_into
from stepbus_orchestrator.run.extensions.calls import Calls, recorded_calls
from stepbus_orchestrator.run.extensions.debug import Debug
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.result import file_sha256
from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_orchestrator.scenario.override import Overrides, override_texts


@dataclass(frozen=True, kw_only=True)
class Branch(Repeated):
    """Result of a branch: a run whose first steps come from a recording.

    at: the first live step. changed: participants whose outputs are used from there on only. way_s:
    time to reach `at` [s]; 0 if the run did not reach it. restored: participants that started from
    a checkpoint, each with its step; all others started at step 0.
    """

    at: int
    changed: Sequence[str]
    way_s: float
    restored: Mapping[str, int] = field(default_factory=dict)


class BranchPlan:
    """A branch that is about to start; the recording's files are unpacked in `out/source`.

    Arguments as of `branch`. at: the first live step. scenario: what runs. notes: what may make it
    different from the recording.

    Raises RecordingFailed when the recording ends before `at`, or `out` already contains a run;
    ScenarioError when the scenario cannot run here; WiringError for a change that a branch does not
    support.
    """

    def __init__(
        self,
        recording: Path,
        at: int | str,
        out: Path,
        overrides: Sequence[str] = (),
        *,
        faults: Sequence[str] = (),
        calls: Sequence[str] = (),
        checkpoints: bool = True,
    ) -> None:
        self._recording = Recording(recording)
        self._out = out
        path = unpack_into(out, Sources.of(self._recording))
        recorded = load(path)
        self.scenario = load(path, overrides, faults)
        self.at = first_live_step(at, self.scenario.step_ns)
        check_change(recorded, self.scenario, self.at, self._recording)
        self._changed = changed_participants(recorded, self.scenario)
        self._new_calls = [call_before(self.at, text, self.scenario) for text in calls]
        self._calls = recorded_calls(self._recording)
        self._sha256 = file_sha256(self._recording.path)
        self.notes = own_version_notes(self._recording)
        self._restored: dict[str, SavedState] = {}
        if checkpoints:
            saved = Checkpoints(self._recording.path, self._sha256)
            unchanged = (s for s in self.scenario.participants if s.name not in self._changed)
            chosen = {spec.name: self._newest(saved, spec) for spec in unchanged}
            self._restored = {name: state for name, state in chosen.items() if state is not None}
            self.notes += saved.problems

    def _newest(self, saved: Checkpoints, spec: ParticipantSpec) -> SavedState | None:
        """Return the newest checkpoint of a participant that the branch does not change.

        It is before a step below that of the branch: so at least one step of the participant is
        compared with the recording.
        """
        called = [call.step for call in self._calls if call.participant == spec.name]
        for state in saved.below(spec.name, self.at):
            fits = state.step % spec.every == 0
            # A participant answers calls while it waits for its own next step, after the state.
            splits = any(state.step - spec.every < step < state.step for step in called)
            if fits and not splits:
                return state
        return None

    def run(
        self,
        observer: Observer | None = None,
        interrupt: threading.Event | None = None,
        *,
        debug: Sequence[str] = (),
        in_process: bool = False,
        owns_descriptors: bool = False,
    ) -> Branch:
        """Run; arguments as of `stepbus run`. A run that fails has its failure in `result`."""
        restored = {name: state.step for name, state in self._restored.items()}
        # What is in a checkpoint is not made again.
        calls = [c for c in self._calls if c.step >= restored.get(c.participant, 0)]
        steps = {
            **self._recording.steps_in(layout.BRANCH_METADATA),
            **dict.fromkeys(self._changed, self.at),
        }
        # In the order of the scenario: it is recorded.
        names = (spec.name for spec in self.scenario.participants)
        counts_from = {name: steps[name] for name in names if steps.get(name)}
        prefix = RecordedPrefix(self._recording, self.at, counts_from, self._restored)
        options = Options(
            out=self._out,
            host=host_of(in_process=in_process, owns_descriptors=owns_descriptors, is_star=True),
            extensions=[prefix, Calls(calls, self._new_calls), Debug(debug)],
        )
        result = run(self.scenario, options, observer, interrupt)
        return Branch(
            recording=self._recording.path,
            recorded_sha256=self._sha256,
            result=result,
            is_part=bool(self._recording.cut_short),
            notes=self.notes,
            at=self.at,
            changed=self._changed,
            way_s=prefix.took_s,
            restored=restored,
        )


def branch(
    recording: Source,
    out: str | PathLike[str],
    *,
    at: int | str,
    set: Overrides = (),  # noqa: A002  as --set on the command line
    calls: Sequence[str] = (),
    faults: Sequence[str] = (),
    in_process: bool = False,
    checkpoints: bool = True,
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
) -> Branch:
    """Replay a recording up to a step, then run live with your changes.

    Before `at`, each participant gets its recorded inputs; `result` names the first one whose
    outputs differ from the recording.

    recording: a run.mcap, or the folder of its run. out: folder of the new run. at: the first live
    step, or its time, e.g. 6s. set: change a parameter from that step on, e.g.
    controller.params.kp=90; may be repeated. The outputs of a changed participant are used from
    `at` on. calls: call a participant before that step, e.g. 'controller set kp 90'; may be
    repeated. faults: inject a fault at that step or later, e.g. 'freeze plant at 1300 for 200ms'.
    in_process: run all participants in one process: faster, same recording. checkpoints: start
    participants from the newest saved state instead of step 0. observer, interrupt: as in `run`.

    Raises RecordingFailed when the recording ends before `at`, or `out` already contains a run;
    ScenarioError when the scenario cannot run here; WiringError for a change that a branch does not
    support.
    """
    prepared = BranchPlan(
        recording_file(recording),
        at,
        Path(out),
        override_texts(set),
        faults=faults,
        calls=calls,
        checkpoints=checkpoints,
    )
    return prepared.run(observer, interrupt, in_process=in_process)
