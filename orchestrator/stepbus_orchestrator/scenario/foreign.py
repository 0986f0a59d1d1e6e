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

    `participant: motor.fmu` is the participant of the scenario that the file stands for, with the
    keys beside it on top, as by `extends`. Raises SettingsError for a file that cannot be read.
    """
    rows, types = participant_rows(document.data), document.data.get("types") or []
    types = types if isinstance(types, list) else [types]
    problems, found = document.problems(), {}
    for name, row in rows.items():
        if scenario_reader(str(row.get("participant"))) is not None:
            keys = ("participants", name, "participant")
            made = problems.attempt(keys, partial(_read, row["participant"], folder))
            if made is not None:
                own = {key: value for key, value in row.items() if key != "participant"}
                found[name] = merged(made[0], own)
                types = [*types, *(item for item in made[1] if item not in types)]
    if not found and not len(problems):
        return document
    problems.refuse()
    participants = {**document.data["participants"], **found}
    return dataclasses.replace(
        document, data={**document.data, "participants": participants, "types": types}
    )


def _read(file: str, folder: Path) -> tuple[dict[str, Any], list[Any]]:
    """Return the participant that a file stands for, and the types of its ports."""
    path, read = folder / file, scenario_reader(file)
    if read is None or not is_file(path):
        raise WiringError(f"no file {file!r} in {folder}")
    data = moved(YamlFile(file=file, data=read(path), places={}), path.parent, folder).data
    (row, *others) = data["participants"].values()
    if others:
        raise WiringError(f"{file} is a scenario of its own; run it, or name it in `extends`")
    return row, data.get("types", [])
