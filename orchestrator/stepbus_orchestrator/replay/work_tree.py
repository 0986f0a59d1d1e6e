"""The scenario that a recording was made from, so that a replay tests today's program.

A recording knows the name of its scenario. The scenario is in the folder that the user names; by
default, it is the file that `result.json` beside the recording names, or one in the current folder.
"""

import os
import stat
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from stepbus_orchestrator.errors import argument
from stepbus_orchestrator.replay.sources import Recorded
from stepbus_orchestrator.run.result import RESULT_FILE
from stepbus_orchestrator.scenario.extend import read_data as read_scenario
from stepbus_orchestrator.scenario.locate import scenario_folders
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_orchestrator.scenario.program import programs_in
from stepbus_orchestrator.scenario.scenario_files import is_file, is_scenario
from stepbus_participant import SettingsError, read_file
from stepbus_schemas import UNDECODABLE, WiringError


class _Origin(msgspec.Struct, frozen=True):
    """What `result.json` says of where a run came from."""

    file: str = ""


@dataclass(frozen=True, kw_only=True)
class WorkTree:
    """A scenario of the user's. file: its path. programs: participant → its class or program."""

    file: Path
    programs: Mapping[str, ParticipantSpec]

    @property
    def folder(self) -> Path:
        """Return the folder of the scenario."""
        return self.file.parent

    @property
    def is_yours(self) -> bool:
        """Return whether only you can have written this scenario."""
        return is_yours(self.file)

    def shown(self) -> str:
        """Return the file's path, relative to the current folder where it is below."""
        here = Path.cwd()
        return str(self.file.relative_to(here) if self.file.is_relative_to(here) else self.file)


def is_yours(path: Path) -> bool:
    """Return whether a file belongs to you, and you alone may write it."""
    try:
        status = path.stat()
    except OSError:
        return False
    return status.st_uid == os.geteuid() and not status.st_mode & stat.S_IWOTH


def find_work_tree(
    recording: Recorded, participant: str, given: Path | None = None
) -> WorkTree | None:
    """Return the scenario of a recording; None where there is none.

    given: its folder or file, if the user names it. Scenarios that ship with stepbus are part of
    the installation. Raises WiringError when `given` has no such scenario, or a folder several.
    """
    name = recording.scenario.get("name")
    places = [_origin(recording), Path.cwd()] if given is None else [given.absolute()]
    found = (_scenario_in(place, name, participant) for place in places if place is not None)
    file = next(filter(None, found), None)
    if file is not None:
        return WorkTree(file=file, programs=programs_in(read_scenario(file)))
    if given is not None:
        raise WiringError(
            f"{given} has no scenario named {name!r} with a participant {participant!r}, as in the "
            "recording"
        )
    return None


def _origin(recording: Recorded) -> Path | None:
    """Return the scenario file that `result.json` names, if both are yours.

    A path within the folder of the recording is not taken: who sends the folder has written both.
    """
    path = recording.path.parent.absolute() / RESULT_FILE
    try:
        origin = msgspec.json.decode(read_file(path), type=_Origin)
    except (OSError, *UNDECODABLE):
        return None
    file = Path(origin.file)
    if not file.is_absolute() or file.resolve().is_relative_to(path.parent.resolve()):
        return None
    return file if is_yours(path) and is_yours(file) and is_file(file) else None


def _scenario_in(place: Path, name: object, participant: str) -> Path | None:
    """Return the scenario of a name that has a participant: a file, or one in a folder."""
    try:
        paths = [place] if is_file(place) else sorted(place.iterdir())
    except OSError:
        return None
    fitting = [path for path in paths if _fits(path, name, participant)]
    if len(fitting) > 1:
        raise WiringError(
            f"several scenarios are named {name!r}: {', '.join(map(str, fitting))}; choose with "
            f"{argument('--source')}"
        )
    return fitting[0] if fitting else None


def _fits(path: Path, name: object, participant: str) -> bool:
    """Return whether a file is a scenario of a name that has a participant."""
    if not is_scenario(path) or _is_builtin(path):
        return False
    try:
        data = read_scenario(path)
    except SettingsError:
        return False
    participants = data.get("participants")
    return (
        data.get("name") == name and isinstance(participants, dict) and participant in participants
    )


def _is_builtin(path: Path) -> bool:
    return any(path.is_relative_to(folder) for folder in scenario_folders().values())
