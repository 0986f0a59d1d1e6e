"""A new reference recording: the old one with one participant's outputs replaced."""

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path

from stepbus_orchestrator.errors import OutputExists, argument
from stepbus_orchestrator.recording import Descriptions, McapFile, Recorder, Recording, Sink, layout
from stepbus_orchestrator.replay.prepare import Prepared
from stepbus_orchestrator.run.folder import read_files
from stepbus_orchestrator.scenario.model import partly_recorded
from stepbus_orchestrator.scenario.resolve import resolved
from stepbus_orchestrator.scenario.schedule import Schedule
from stepbus_participant import irregular


@contextlib.contextmanager
def new_reference(target: Path | None, old: Recording, prepared: Prepared) -> Iterator[Sink]:
    """Yield what takes the outputs; the file gets its name at the end, if nothing has failed.

    target: must not exist; None: nothing is written. prepared: what is attached: its scenario, and
    its files of the work tree, or else those of the old recording. Raises RecordingFailed when it
    exists or cannot be written.
    """
    scenario = prepared.scenario
    order = [scenario.participant(name) for name in Schedule(scenario).order]
    if target is None:
        yield Sink({spec.name: spec.outputs for spec in order}, partly_recorded(order))
        return
    if irregular(target) or target.exists():
        raise OutputExists(
            f"{target} already exists; choose another name with {argument('--update')}"
        )
    part = target.with_name(f".{target.name}.part")
    file = McapFile(part)
    try:
        _describe(file, old, prepared)
        reference = _Reference(file, order, scenario.step_ns, types=scenario.types)
        reference.recorded_versions = layout.versions_of(old.metadata)
        yield reference
        part.replace(target)
    finally:
        file.close()
        part.unlink(missing_ok=True)


def _describe(file: McapFile, old: Recording, prepared: Prepared) -> None:
    text = old.attachments[layout.SCENARIO_ATTACHMENT]
    if prepared.is_changed:
        text = resolved(prepared.scenario).encode()
    contents = layout.files_of(old.attachments)
    if prepared.files is not None:
        contents = read_files(prepared.files)
    file.attach(layout.SCENARIO_ATTACHMENT, "application/yaml", text)
    for name, content in contents.items():
        file.attach(layout.file_attachment(name), "application/octet-stream", content)
    participants = {layout.versions_metadata(spec.name) for spec in prepared.scenario.participants}
    for name, metadata in old.metadata.items():
        if name not in participants:
            file.add_metadata(name, metadata)


class _Reference(Recorder):
    """recorded_versions: what the participants that are played ran on."""

    recorded_versions: Mapping[str, Mapping[str, str]] = {}

    def open_channels(
        self, descriptions: Descriptions, versions: Mapping[str, Mapping[str, str]]
    ) -> None:
        """Register the channels, also of participants that are played."""
        super().open_channels(descriptions, {**self.recorded_versions, **versions})
