"""Finds the scenario of a recording in the work tree, so that a replay tests today's program.

A recording knows the name of its scenario and the relative paths of its files, no path of a
machine. The scenario is where `result.json` beside the recording says, or else above or below
the current folder or the recording's.
"""

import contextlib
import os
import stat
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.errors import argument
from stepbus_orchestrator.recording import Recording, layout
from stepbus_orchestrator.run.result import RESULT_FILE
from stepbus_orchestrator.scenario import (
    ParticipantSpec,
    builtin_folders,
    upgraded,
    written_program,
)
from stepbus_orchestrator.scenario import read_data as read_scenario
from stepbus_orchestrator.scenario.paths import BUILT, is_scenario
from stepbus_participant import SettingsError, read_file
from stepbus_participant.parameters import parse_yaml
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
    """A scenario of the work tree. file: its path. overrides: with which it was recorded."""

    file: Path
    overrides: Sequence[str] = ()

    @property
    def folder(self) -> Path:
        """Return the folder of the scenario."""
        return self.file.parent

    @property
    def is_yours(self) -> bool:
        """Return whether nobody but you can have written this scenario."""
        return _is_yours(self.file)

    def has(self, name: str, content: bytes) -> bool:
        """Return whether a file of the folder is yours, and equal to a recorded one."""
        path = self.folder / name
        try:
            return _is_yours(path) and read_file(path) == content
        except OSError:
            return False

    def participants(self) -> dict[str, Any]:
        """Return the rows of the participants, as the file has them."""
        rows: dict[str, Any] = upgraded(read_scenario(self.file))["participants"]
        return rows

    def program(self, participant: str) -> ParticipantSpec:
        """Return the class or program of a participant, as the file has it."""
        return written_program(participant, self.participants()[participant])

    def shown(self) -> str:
        """Return the file's path, relative to the current folder where it is below."""
        here = Path.cwd()
        return str(self.file.relative_to(here) if self.file.is_relative_to(here) else self.file)


def find_work_tree(
    recording: Recording, participant: str, given: Path | None = None
) -> WorkTree | None:
    """Return the scenario of a recording in the work tree; None where there is none.

    given: its folder or file, if the user names it. Scenarios that ship with stepbus are part of
    the installation, and in no work tree. Raises WiringError when `given` has no such scenario, or
    several folders have one.
    """
    trusted = _owners(recording.path)
    recorded, origin = _recorded(recording), _origin(recording.path, trusted)
    if given is not None:
        return _tree(_given(given, recorded, participant), origin, recorded)
    file = Path(origin.file)
    is_own = bool(origin.file) and not _is_builtin(file) and _owner(file) in trusted
    if not (is_own and _fits(file, recorded, participant)):
        file = next(_near(recording.path, recorded, participant, trusted), Path())
    return _tree(file, origin, recorded) if file.name else None


def _tree(file: Path, origin: _Origin, recorded: Mapping[str, Any]) -> WorkTree:
    """Return a scenario with those overrides that apply to it."""
    tree = WorkTree(file=file)
    rows = tree.participants()
    kept = [
        override
        for override in origin.overrides
        if _keys(override)[0] in rows and _is_recorded(override, recorded)
    ]
    return replace(tree, overrides=kept)


def _near(
    recording: Path, recorded: Mapping[str, Any], participant: str, trusted: frozenset[int]
) -> Iterator[Path]:
    """Yield the nearest scenario; raises WiringError when several are equally near."""
    starts = list(dict.fromkeys((Path.cwd(), recording.parent.absolute())))
    for folder in (folder for start in starts for folder in (start, *_above(start))):
        if (file := _in_folder(folder, recorded, participant)) and _owner(file) in trusted:
            yield file
            return
    # Below a folder that is no repository, there may be anything: only below the current one.
    roots = [(start, *_above(start))[-1] for start in starts if _is_in_repository(start)]
    roots = list(dict.fromkeys(roots or starts[:1]))
    files = [
        file
        for root in roots
        for folder in _below(root)
        if (file := _in_folder(folder, recorded, participant)) and _owner(file) in trusted
    ]
    files = list(dict.fromkeys(files))
    if len(files) > 1:
        shown = ", ".join(map(str, files))
        raise WiringError(
            f"several scenarios are named {recorded.get('name')!r}: {shown}; choose with "
            f"{argument('--source')}"
        )
    yield from files


def _owners(recording: Path) -> frozenset[int]:
    """Return whose programs may be taken: yours, and those of its owner."""
    return frozenset({os.geteuid(), _owner(recording)})


def _owner(path: Path) -> int:
    try:
        return path.stat().st_uid
    except OSError:
        return -1


def _recorded(recording: Recording) -> dict[str, Any]:
    text = recording.attachments.get(layout.SCENARIO_ATTACHMENT, b"").decode(errors="replace")
    with contextlib.suppress(SettingsError):
        data = parse_yaml(layout.SCENARIO_ATTACHMENT, text)
        if isinstance(data, dict):
            return data
    return {}


def _origin(recording: Path, trusted: frozenset[int]) -> _Origin:
    """Return what `result.json` says, if it belongs to somebody who is trusted."""
    path = recording.parent / RESULT_FILE
    try:
        if not path.is_file() or _owner(path) not in trusted:
            return _Origin()
        return msgspec.json.decode(read_file(path), type=_Origin)
    except (OSError, *UNDECODABLE):
        return _Origin()


def _keys(override: str) -> list[str]:
    """Return the path of an override, from its participant on."""
    keys = [key.strip() for key in override.partition("=")[0].split(".")]
    return keys[1:] if keys[0] == "participants" and keys[1:] else keys


def _is_recorded(override: str, recorded: Mapping[str, Any]) -> bool:
    """Return whether an override is a deadline, or a parameter that has its recorded value.

    None of these starts anything. Other values are of another run than that of the recording.
    """
    keys = _keys(override)
    if len(keys) == 2 and keys[1].endswith("_timeout"):
        return True
    try:
        value = parse_yaml("", override.partition("=")[2])
        participants: Any = recorded["participants"]
        for key in keys:
            participants = (
                participants[int(key)]
                if isinstance(participants, list)
                else (participants or {}).get(key)
            )
    except (SettingsError, KeyError, ValueError, IndexError, AttributeError):
        return False
    return keys[1:2] == ["params"] and _agrees(participants, value)


def _agrees(recorded: Any, value: Any) -> bool:
    """Return whether a recorded value is one that was set; later overrides may add to a map."""
    if isinstance(recorded, dict) and isinstance(value, dict):
        return all(_agrees(recorded.get(key), item) for key, item in value.items())
    return bool(recorded == value)


def _is_yours(path: Path) -> bool:
    """Return whether a file belongs to you, and not everybody may write it."""
    try:
        status = path.stat()
    except OSError:
        return False
    return status.st_uid == os.geteuid() and not status.st_mode & stat.S_IWOTH


def _given(given: Path, recorded: Mapping[str, Any], participant: str) -> Path:
    path = given.absolute()
    file = path if _fits(path, recorded, participant) else _in_folder(path, recorded, participant)
    if file is None:
        raise WiringError(
            f"{given} has no scenario named {recorded.get('name')!r} with a participant "
            f"{participant!r}, as the recording"
        )
    return file


def _above(folder: Path) -> list[Path]:
    """Return the folders above one, up to the root of its repository; none without a repository."""
    for depth, parent in enumerate((folder, *folder.parents)):
        if _is_root(parent):
            return list(folder.parents)[:depth]
    return []


def _is_in_repository(folder: Path) -> bool:
    return any(map(_is_root, (folder, *folder.parents)))


def _is_root(folder: Path) -> bool:
    try:
        return any((folder / mark).exists() for mark in _REPOSITORY)
    except OSError:
        return False


def _below(root: Path) -> Iterator[Path]:
    """Yield the folders below one, the nearest ones first; those of runs are left out."""
    queue, seen = [(root, 0)], 0
    while queue and seen < _MOST_FOLDERS:
        folder, depth = queue.pop(0)
        seen += 1
        try:
            entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
        except OSError:
            continue
        if any(entry.name == layout.TIMING_FILE for entry in entries) or _is_builtin(folder):
            continue
        yield folder
        if depth < _DEEPEST:
            queue += [(Path(e.path), depth + 1) for e in entries if _is_searched(e)]


def _is_searched(entry: os.DirEntry[str]) -> bool:
    try:
        is_folder = entry.is_dir(follow_symlinks=False)
    except OSError:
        return False
    return is_folder and not entry.name.startswith(".") and entry.name not in BUILT


def _in_folder(folder: Path, recorded: Mapping[str, Any], participant: str) -> Path | None:
    """Return the scenario of a folder that is most like the recorded one; None without any."""
    try:
        files = sorted(path for path in folder.iterdir() if path.suffix in {".yaml", ".yml"})
    except OSError:
        return None
    fitting = [path for path in files if _fits(path, recorded, participant)]
    return min(fitting, key=lambda path: _distance(read_scenario(path), recorded), default=None)


def _fits(path: Path, recorded: Mapping[str, Any], participant: str) -> bool:
    """Return whether a file is a scenario of the recorded name that has a participant."""
    try:
        if not is_scenario(path):
            return False
        data = read_scenario(path)
    except (OSError, UnicodeDecodeError, SettingsError):
        return False
    participants = data.get("participants")
    return isinstance(participants, dict) and (
        data.get("name") == recorded.get("name") and participant in participants
    )


def _distance(data: Any, recorded: Any) -> int:
    """Return how many values of two scenarios differ."""
    if isinstance(data, dict) and isinstance(recorded, dict):
        return sum(_distance(data.get(key), recorded.get(key)) for key in {*data, *recorded})
    return int(data != recorded)


def _is_builtin(path: Path) -> bool:
    return any(path.is_relative_to(folder) for folder in builtin_folders())
