"""Writes a new reference recording: the old one with one participant's outputs replaced."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from stepbus_orchestrator.errors import OutputExists, argument
from stepbus_orchestrator.recording import McapFile, Recorder, Recording, layout
from stepbus_orchestrator.recording.known_programs import fingerprint, remember
from stepbus_orchestrator.replay.prepare import Prepared
from stepbus_orchestrator.run.folder import read_files
from stepbus_orchestrator.scenario import Schedule, resolved
from stepbus_participant import irregular


@contextlib.contextmanager
def new_reference(
    target: Path | None, old: Recording, prepared: Prepared
) -> Iterator[Recorder | None]:
    """Yield what takes the outputs; the file gets its name at the end, if nothing has failed.

    target: must not exist; None: nothing is written. prepared: what is attached: its scenario, and
    its files of the work tree, or else those of the old recording. Raises RecordingFailed when it
    exists or cannot be written.
    """
    if target is None:
        yield None
        return
    if irregular(target) or target.exists():
        raise OutputExists(
            f"{target} exists already; choose another name with {argument('--update')}"
        )
    part = target.with_name(f".{target.name}.part")
    file = McapFile(part)
    scenario = prepared.scenario
    text = (
        resolved(scenario).encode()
        if prepared.is_changed
        else old.attachments[layout.SCENARIO_ATTACHMENT]
    )
    try:
        contents = _files(old) if prepared.files is None else read_files(prepared.files)
        file.attach(layout.SCENARIO_ATTACHMENT, "application/yaml", text)
        for name, content in contents.items():
            file.attach(layout.file_attachment(name), "application/octet-stream", content)
        for name, versions in old.metadata.items():
            if layout.versions_owner(name) in {None, layout.ORCHESTRATOR}:
                file.add_metadata(name, versions)
        order = [scenario.participant(name) for name in Schedule.of(scenario).order]
        yield Recorder(file, order, scenario.step_ns, types=scenario.types)
        part.replace(target)
        # It holds what has just been started here.
        remember(fingerprint(text, contents))
    finally:
        file.close()
        part.unlink(missing_ok=True)


def _files(recording: Recording) -> dict[str, bytes]:
    return {
        file: content
        for name, content in recording.attachments.items()
        if (file := layout.attached_file(name)) is not None
    }
