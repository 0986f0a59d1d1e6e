"""Runs a recording's scenario again from nothing but the recording."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from stepbus_orchestrator.analysis.diff import Diff, diff
from stepbus_orchestrator.recording import Recording, layout
from stepbus_orchestrator.recording.layout import Source, recording_file
from stepbus_orchestrator.replay.prefix import RecordedPrefix
from stepbus_orchestrator.replay.recorded import recorded_end
from stepbus_orchestrator.replay.sources import (
    Sources,
    own_version_notes,
    unpack_into,
    version_notes,
)
from stepbus_orchestrator.run.extensions.calls import Calls, recorded_calls
from stepbus_orchestrator.run.hosts import Processes
from stepbus_orchestrator.run.reports import Observer
from stepbus_orchestrator.run.result import Result, file_sha256
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.override import Overrides, override_texts
from stepbus_orchestrator.scenario.resolve import resolved


@dataclass(frozen=True, kw_only=True)
class Repeated:
    """A run made from a recording.

    recorded_sha256: of the recording it was made from. is_part: whether that is cut off, has a
    hole, or ended before this run did. notes: what may make it different, one sentence each.
    """

    recording: Path
    recorded_sha256: str
    result: Result
    is_part: bool = False
    notes: Sequence[str] = ()

    @property
    def equal(self) -> bool:
        """Return whether the new recording is the old one, byte for byte."""
        return self.recorded_sha256 == self.result.sha256

    def diff(self) -> Diff:
        """Compare what both have: of a recording that is cut off, up to its end."""
        return diff(self.recording, self.result.recording, is_part=self.is_part)


@dataclass(frozen=True, kw_only=True)
class Rerun(Repeated):
    """Result of a rerun.

    recorded_steps: number of steps in the recording. flaws: its damage and gaps, which are also in
    the notes.
    """

    recorded_steps: int = 0
    flaws: Sequence[str] = ()

    @property
    def compares(self) -> bool:
        """Return whether there is anything to compare: steps in both."""
        return bool(self.recorded_steps and self.result.steps)


class Preparation:
    """A run from a recording that is about to start; its files are unpacked in `out/source`.

    overrides: settings such as `window=1`. notes: what may make it different from the recorded one.
    Raises RecordingFailed when the recording is not fit for it or `out` holds a run already,
    and ScenarioError when the scenario cannot run here.
    """

    def __init__(self, recording: Path, out: Path, overrides: Sequence[str] = ()) -> None:
        self._recording = Recording(recording)
        self._out = out
        self._is_changed = bool(overrides)
        sources = Sources.of(self._recording)
        self.scenario = load(unpack_into(out, sources), overrides)
        self._flaws = self._recording.flaws()
        self.notes = [f"the recording {flaw}" for flaw in self._flaws]
        if resolved(self.scenario).encode() != sources.scenario:
            given = f"--set {' '.join(overrides)}"
            cause = given if overrides else "this version reads it differently"
            self.notes.append(f"the scenario differs from the recorded one: {cause}")
        if self.scenario.steps is None:
            self.notes.append(
                f"the scenario has no duration, the recording has {recorded_end(self._recording)} "
                "steps; if no participant ends the run, end it with Ctrl-C or give it one with "
                "--set duration=…"
            )
        self.notes += own_version_notes(self._recording)

    def run(
        self, observer: Observer | None = None, interrupt: threading.Event | None = None
    ) -> Rerun:
        """Run, and compare with the recording; observer, interrupt: as in `run`."""
        recording, end = self._recording, recorded_end(self._recording)
        # The first steps of a branch can only come from its recording.
        changed = recording.steps_in(layout.BRANCH_METADATA)
        prefix = [RecordedPrefix(recording, max(changed.values()), changed)] if changed else []
        options = Options(
            out=self._out,
            host=Processes(is_star=bool(prefix)),
            extensions=[*prefix, Calls(recorded_calls(recording))],
        )
        result = run(self.scenario, options, observer, interrupt)
        now = layout.versions_of(Recording(result.recording).metadata)
        later = [
            note
            for name, recorded in layout.versions_of(recording.metadata).items()
            if name != layout.ORCHESTRATOR and name in now
            for note in version_notes(name, recorded, now[name])
        ]
        planned = self.scenario.steps
        ends_early = planned is not None and not self._is_changed and end < planned
        return Rerun(
            recording=recording.path,
            recorded_sha256=file_sha256(recording.path),
            result=result,
            recorded_steps=end,
            is_part=bool(self._flaws) or (ends_early and end < result.steps),
            flaws=self._flaws,
            notes=[*self.notes, *later],
        )


def rerun(
    recording: Source,
    out: str | PathLike[str],
    *,
    set: Overrides = (),  # noqa: A002  as --set on the command line
    observer: Observer | None = None,
    interrupt: threading.Event | None = None,
) -> Rerun:
    """Run the scenario of a recording again, from the recording alone.

    recording: a run.mcap, or the folder of its run. out: folder of the new run. set: override one
    value, e.g. window=1; may be repeated. observer, interrupt: as in `run`.

    Raises RecordingFailed when the recording contains no scenario, OutputExists when `out` already
    contains a run.
    """
    preparation = Preparation(recording_file(recording), Path(out), override_texts(set))
    return preparation.run(observer, interrupt)
