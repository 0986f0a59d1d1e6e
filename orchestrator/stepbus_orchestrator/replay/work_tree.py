"""Finds the scenario of a recording in the work tree, so that a replay tests today's program.

A recording knows the name of its scenario and the relative paths of its files, no path of a
machine. The scenario is where `result.json` beside the recording says, or else above or below
the current folder or the recording's.
"""

import os
import stat
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.errors import argument
from stepbus_orchestrator.replay.sources import Recorded
from stepbus_orchestrator.run.result import RESULT_FILE
from stepbus_orchestrator.scenario.extend import read_data as read_scenario
from stepbus_orchestrator.scenario.locate import scenario_folders
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_orchestrator.scenario.override import override
from stepbus_orchestrator.scenario.program import programs_in
from stepbus_orchestrator.scenario.scenario_files import (
    BUILT,
    MARKS,
    is_file,
    is_folder,
    is_scenario,
)
from stepbus_participant import SettingsError, read_file
from stepbus_participant.parameters import YamlFile
from stepbus_schemas import UNDECODABLE, WiringError

_MOST_FOLDERS = 2000
_DEEPEST = 5
_REPOSITORY = (".git", ".hg", ".jj", "pyproject.toml")


class _Origin(msgspec.Struct, frozen=True):
    """What `result.json` says of where a run came from."""

    file: str = ""
    overrides: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class WorkTree:
    """A scenario of the work tree.

    file: its path. programs: participant → its class or program. overrides: with which it was
    recorded, as far as they apply to it.
    """

    file: Path
    programs: Mapping[str, ParticipantSpec]
    overrides: Sequence[str] = ()

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
    """Return the scenario of a recording in the work tree; None where there is none.

    given: its folder or file, if the user names it. Scenarios that ship with stepbus are part of
    the installation, and in no work tree. Raises WiringError when `given` has no such scenario, or
    several folders have one.
    """
    recorded, folder = recording.scenario, recording.path.parent.absolute()
    # A program may be taken from you, and from the owner of the recording.
    owners = {os.geteuid(), _owner(recording.path)}
    origin = _origin(folder, owners)
    search = _Search(recorded, participant, owners)
    if given is not None:
        file = _Search(recorded, participant).at(given.absolute())
        if file is None:
            raise WiringError(
                f"{given} has no scenario named {recorded.get('name')!r} with a "
                f"participant {participant!r}, as in the recording"
            )
    else:
        file = search.at(Path(origin.file)) if origin.file else None
        file = file or search.near(folder)
    if file is None:
        return None
    programs = programs_in(read_scenario(file))
    overrides = _applicable(origin.overrides, recorded, programs)
    return WorkTree(file=file, programs=programs, overrides=overrides)


@dataclass(frozen=True)
class _Search:
    """recorded: the scenario of the recording. owners: of files that are taken; None: any."""

    recorded: Mapping[str, Any]
    participant: str
    owners: Collection[int] | None = None

    def near(self, folder: Path) -> Path | None:
        """Return the nearest one; raises WiringError when several are equally near.

        folder: of the recording.
        """
        starts = {start: _repository(start) for start in (Path.cwd(), folder)}
        for start, root in starts.items():
            inside = [top for top in start.parents if root and top.is_relative_to(root)]
            if file := next(filter(None, map(self._in, (start, *inside))), None):
                return file
        # Below a folder that is no repository, there may be anything: only below the current one.
        roots = dict.fromkeys(filter(None, starts.values())) or [Path.cwd()]
        files = filter(None, (self._in(folder) for root in roots for folder in _below(root)))
        different = list(dict.fromkeys(files))
        if len(different) > 1:
            raise WiringError(
                f"several scenarios are named {self.recorded.get('name')!r}: "
                f"{', '.join(map(str, different))}; choose with {argument('--source')}"
            )
        return different[0] if different else None

    def at(self, path: Path) -> Path | None:
        """Return the scenario of a path, which is its own or that of its folder."""
        return path if self._fits(path) else self._in(path)

    def _in(self, folder: Path) -> Path | None:
        """Return the scenario of a folder that is most like the recorded one; None without any."""
        try:
            fitting = [path for path in sorted(folder.iterdir()) if self._fits(path)]
        except OSError:
            return None
        likeness = {path: _distance(read_scenario(path), self.recorded) for path in fitting}
        return min(likeness, key=likeness.__getitem__, default=None)

    def _fits(self, path: Path) -> bool:
        """Return whether a file is a scenario of the recorded name that has the participant."""
        if not is_scenario(path):
            return False
        if self.owners is not None and (_is_builtin(path) or _owner(path) not in self.owners):
            return False
        try:
            data = read_scenario(path)
        except SettingsError:
            return False
        participants = data.get("participants")
        is_named = data.get("name") == self.recorded.get("name")
        return is_named and isinstance(participants, dict) and self.participant in participants


def _distance(data: Any, recorded: Any) -> int:
    """Return how many values of two scenarios differ."""
    if isinstance(data, dict) and isinstance(recorded, dict):
        return sum(_distance(data.get(key), recorded.get(key)) for key in {*data, *recorded})
    return int(data != recorded)


def _repository(folder: Path) -> Path | None:
    """Return the root of the repository that a folder is in."""
    above = (folder, *folder.parents)
    marks = ((top, top / mark) for top in above for mark in _REPOSITORY)
    return next((top for top, mark in marks if is_file(mark) or is_folder(mark)), None)


def _below(root: Path) -> Iterator[Path]:
    """Yield the folders below one, the nearest ones first, but those of runs and sweeps."""
    level, left = [root], _MOST_FOLDERS
    for _ in range(_DEEPEST + 1):
        below: list[Path] = []
        for folder in level[:left]:
            try:
                entries = sorted(folder.iterdir())
            except OSError:
                continue
            if MARKS.isdisjoint(path.name for path in entries):
                yield folder
                below += filter(_is_searched, entries)
        level, left = below, max(0, left - len(level))


def _is_searched(path: Path) -> bool:
    is_own = is_folder(path) and not path.is_symlink()
    return is_own and not path.name.startswith(".") and path.name not in BUILT


def _is_builtin(path: Path) -> bool:
    return any(path.is_relative_to(folder) for folder in scenario_folders().values())


def _owner(path: Path) -> int:
    try:
        return path.stat().st_uid
    except OSError:
        return -1


def _origin(folder: Path, owners: Collection[int]) -> _Origin:
    """Return what `result.json` says, if it belongs to one of the owners."""
    path = folder / RESULT_FILE
    try:
        if not path.is_file() or _owner(path) not in owners:
            return _Origin()
        return msgspec.json.decode(read_file(path), type=_Origin)
    except (OSError, *UNDECODABLE):
        return _Origin()


def _applicable(
    overrides: Sequence[str], recorded: Mapping[str, Any], programs: Mapping[str, ParticipantSpec]
) -> list[str]:
    """Return the overrides that are deadlines, or parameters with their recorded values.

    None of these starts anything. Other values are of another run than that of the recording.
    """
    paths = {text: _path(text) for text in overrides}
    known = {text: path for text, path in paths.items() if path[0] in programs}
    params = [text for text, path in known.items() if path[1:2] == ["params"]]
    document = YamlFile(file="", data=dict(recorded), places={})
    changed = override(document, params)
    is_recorded = changed.data == document.data and not changed.own_problems
    return [
        text
        for text, path in known.items()
        if (text in params and is_recorded) or (len(path) == 2 and path[1].endswith("_timeout"))
    ]


def _path(override: str) -> list[str]:
    """Return the path of an override, from its participant on."""
    keys = [key.strip() for key in override.partition("=")[0].split(".")]
    return keys[1:] if keys[0] == "participants" and keys[1:] else keys
