"""Writes a new reference recording: the old one with one participant's outputs replaced."""

from __future__ import annotations

from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import McapFile, Recorder, Recording, layout
from stepbus_orchestrator.scenario import Scenario, Schedule, resolved


class Reference:
    """A recording in the making, beside its final name, which it gets by `keep`.

    target: must not exist. scenario: what is attached, with the files of the old recording.
    recorder: takes the outputs. Raises RecordingFailed when it exists or cannot be written.
    """

    def __init__(
        self, target: Path, old: Recording, scenario: Scenario, *, is_changed: bool
    ) -> None:
        if target.exists():
            raise RecordingFailed(f"{target} exists already; choose another name with --update")
        self._target = target
        self._part = target.with_name(f".{target.name}.part")
        file = McapFile(self._part)
        for name, data in old.attachments.items():
            is_scenario = name == layout.SCENARIO_ATTACHMENT
            content = resolved(scenario).encode() if is_scenario and is_changed else data
            media_type = "application/yaml" if is_scenario else "application/octet-stream"
            file.attach(name, media_type, content)
        for name, versions in old.metadata.items():
            if layout.versions_owner(name) in {None, layout.ORCHESTRATOR}:
                file.add_metadata(name, versions)
        order = [scenario.participant(name) for name in Schedule.of(scenario).order]
        self.recorder = Recorder(file, order, scenario.step_ns)
        self._file = file

    def keep(self) -> None:
        """Give the finished recording its name."""
        self._part.replace(self._target)

    def discard(self) -> None:
        """Remove what there is, unless it was kept."""
        self._file.close()
        self._part.unlink(missing_ok=True)
