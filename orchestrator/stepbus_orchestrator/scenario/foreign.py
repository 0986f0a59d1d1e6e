"""A participant that is a file of another tool, such as an FMU, which a package reads."""

import dataclasses
from functools import partial
from pathlib import Path
from typing import Any

from stepbus_orchestrator.plugins import scenario_reader
from stepbus_orchestrator.scenario.extend import merged, moved, participant_rows
from stepbus_orchestrator.scenario.scenario_files import is_file
from stepbus_participant.parameters import YamlFile
from stepbus_schemas import WiringError


def with_participants(document: YamlFile, folder: Path) -> YamlFile:
    """Return a scenario whose participants have what the files say that they name.

    `participant: motor.fmu` is the one participant of the scenario that the file stands for, with
    the keys beside it on top, as by `extends`. Raises SettingsError for a file that is not there
    or cannot be read.
    """
    rows, types = participant_rows(document.data), document.data.get("types")
    found = {name: str(row["participant"]) for name, row in rows.items() if "participant" in row}
    found = {name: file for name, file in found.items() if scenario_reader(file) is not None}
    if not found:
        return document
    problems = document.problems()
    for name, file in found.items():
        keys = ("participants", name, "participant")
        made = problems.attempt(keys, partial(_participant, file, folder))
        if made is not None:
            row, more = made
            own = {key: value for key, value in rows[name].items() if key != "participant"}
            rows[name] = merged(row, own)
            types = _joined(types, more)
    problems.refuse()
    data = {**document.data, "participants": {**document.data["participants"], **rows}}
    return dataclasses.replace(document, data=data if types is None else {**data, "types": types})


def _participant(file: str, folder: Path) -> tuple[dict[str, Any], Any]:
    """Return the participant that a file stands for, and the types of its ports."""
    path, read = folder / file, scenario_reader(file)
    if read is None or not is_file(path):
        raise WiringError(f"no file {file!r} in {folder}")
    data = moved(YamlFile(file=file, data=read(path), places={}), path.parent, folder).data
    if len(data["participants"]) != 1:
        raise WiringError(f"{file} is a scenario of its own; run it, or name it in `extends`")
    return next(iter(data["participants"].values())), data.get("types")


def _joined(types: Any, more: Any) -> Any:
    """Return the types of a scenario, and others."""
    parts = types if isinstance(types, list) else [] if types in (None, {}) else [types]
    added = [item for item in (more or []) if item not in parts]
    return [*parts, *added] or types
