"""Writes a new reference recording: the old one with one participant's outputs replaced."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import McapFile, Recorder, Recording, layout
from stepbus_orchestrator.recording.known_programs import fingerprint, remember
from stepbus_orchestrator.scenario import Scenario, Schedule, resolved


@contextlib.contextmanager
def new_reference(
    target: Path | None, old: Recording, scenario: Scenario, *, is_changed: bool
) -> Iterator[Recorder | None]:
    """Yield what takes the outputs; the file gets its name at the end, if nothing has failed.

    target: must not exist; None: nothing is written. scenario: what is attached, with the files
    of the old recording. Raises RecordingFailed when it exists or cannot be written.
    """
    if target is None:
        yield None
        return
    if target.exists():
        raise RecordingFailed(f"{target} exists already; choose another name with --update")
    part = target.with_name(f".{target.name}.part")
    file = McapFile(part)
    scenario_text, contents = b"", {}
    try:
        for name, data in old.attachments.items():
            is_scenario = name == layout.SCENARIO_ATTACHMENT
            content = resolved(scenario).encode() if is_scenario and is_changed else data
            media_type = "application/yaml" if is_scenario else "application/octet-stream"
            file.attach(name, media_type, content)
            if is_scenario:
                scenario_text = content
            elif (own := layout.attached_file(name)) is not None:
                contents[own] = content
        for name, versions in old.metadata.items():
            if layout.versions_owner(name) in {None, layout.ORCHESTRATOR}:
                file.add_metadata(name, versions)
        order = [scenario.participant(name) for name in Schedule.of(scenario).order]
        yield Recorder(file, order, scenario.step_ns)
        part.replace(target)
        # It holds what has just been started here.
        remember(fingerprint(scenario_text, contents))
    finally:
        file.close()
        part.unlink(missing_ok=True)
