"""Where the scenario of a recording is, and which recorded programs start without `--trust`.

Those that installed packages declare start, and those that equal the programs of that scenario.
"""

import contextlib
import os
import shlex
import stat
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import msgspec

from stepbus_orchestrator.replay.sources import Recorded, Sources
from stepbus_orchestrator.run.result import RESULT_FILE
from stepbus_orchestrator.scenario.extend import participant_rows, read_extended
from stepbus_orchestrator.scenario.locate import scenario_folders
from stepbus_orchestrator.scenario.program import participant_classes
from stepbus_orchestrator.scenario.scenario_files import is_file, texts_in
from stepbus_participant import SettingsError, is_installed, read_file
from stepbus_schemas import UNDECODABLE, WiringError

_DATA = (
    *(".csv", ".dae", ".jpg", ".json", ".md", ".mtl", ".obj", ".png", ".srdf", ".stl", ".txt"),
    *(".urdf", ".xml", ".yaml", ".yml"),
)
"""Files that no program of ours executes; a `.xacro` has expressions."""


class _Origin(msgspec.Struct, frozen=True):
    """What `result.json` says of where a run came from."""

    file: str = ""


def find_source(recording: Recorded, given: Path | None = None) -> Path | None:
    """Return the file of the scenario that a recording was made from; None where there is none.

    given: its file or folder, if the user names it; default: the file that `result.json` names, or
    else one in the current folder, if it is the user's. Raises WiringError when `given` has no such
    scenario, or a folder several.
    """
    name = recording.scenario.get("name")
    if given is None and (origin := _origin(recording)) and _is_named(origin, name):
        return origin
    place = Path.cwd() if given is None else given.absolute()
    paths = [place] if is_file(place) else sorted(place.glob("*.y*ml"))
    matches = [p for p in paths if _is_named(p, name) and (given is not None or _is_yours(p))]
    if len(matches) > 1:
        raise WiringError(
            f"several scenarios are named {name!r}: {', '.join(map(str, matches))}; choose with "
            "--source"
        )
    if given is not None and not matches:
        raise WiringError(f"{given} has no scenario named {name!r}, as in the recording")
    return matches[0] if matches else None


def _origin(recording: Recorded) -> Path | None:
    """Return the scenario file that `result.json` names, if both are the user's.

    A path within the folder of the recording is not taken: who sends the folder has written both.
    Scenarios that are installed are not taken either: their recorded copy is what was meant.
    """
    path = recording.path.parent.absolute() / RESULT_FILE
    try:
        file = Path(msgspec.json.decode(read_file(path), type=_Origin).file)
    except (OSError, *UNDECODABLE):
        return None
    others = (path.parent.resolve(), *scenario_folders().values())
    is_inside = any(file.resolve().is_relative_to(folder) for folder in others)
    return file if file.is_absolute() and not is_inside and _is_yours(path, file) else None


def _is_yours(*paths: Path) -> bool:
    """Return whether files belong to the user, and nobody else may write them."""
    try:
        rows = [path.stat() for path in paths]
    except OSError:
        return False
    return all(row.st_uid == os.geteuid() and not row.st_mode & stat.S_IWOTH for row in rows)


def _is_named(path: Path, name: object) -> bool:
    try:
        return read_extended(path).data.get("name") == name
    except SettingsError:
        return False


@dataclass(frozen=True, kw_only=True)
class Programs:
    """What a recording would start, with the user's rights.

    commands: participant → its command line or class, and the classes that its parameters name;
    not those that installed packages declare. files: those that a program may execute. is_yours:
    whether the user's scenario has all of them like this. edited: files of that scenario that
    differ from the recorded ones.
    """

    commands: Mapping[str, Sequence[str]]
    files: Sequence[str]
    is_yours: bool
    edited: Sequence[str] = ()

    def lines(self) -> list[str]:
        """Return what would be started, one line each; no character of it controls a terminal."""
        width = max(map(len, self.commands), default=0)
        commands = (f"{name:{width}}  {shlex.join(c)}" for name, c in self.commands.items())
        files = [f"its files: {', '.join(self.files)}"] if self.files else []
        lines = (*commands, *files, *self.notes())
        return [
            "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in line) for line in lines
        ]

    def notes(self) -> list[str]:
        """Return a sentence for each file that the user has edited since."""
        return [f"{name} differs from the recording, whose own copy runs" for name in self.edited]


def programs_of(
    recording: Recorded, participant: str | None = None, *, own_program: bool = False
) -> Programs:
    """Return what a recording would start.

    participant: the only one that is started; default: all. own_program: it is started with a
    program of the user's.

    Raises RecordingFailed when the recording holds no scenario, or a file whose name leads out of
    its folder.
    """
    recorded = Sources.of(recording).files
    files = {name: content for name, content in recorded.items() if not _is_shipped(name, content)}
    code = {n: files[n] for n in files if PurePosixPath(n).suffix.lower() not in _DATA}
    words = {
        name: _words(row, own_program=own_program)
        for name, row in participant_rows(recording.scenario).items()
        if participant in {None, name}
    }
    commands = {name: command for name, command in words.items() if command}
    home = None
    if commands or files:
        with contextlib.suppress(WiringError):
            home = find_source(recording)
    has_all = not (commands or code)
    edited: Sequence[str] = ()
    if home is not None:
        rows = participant_rows(read_extended(home).data)
        is_same = all(
            _words(rows.get(name, {}), own_program=own_program) == command
            for name, command in commands.items()
        )
        paths = {name: home.parent / name for name in files}
        has_all |= is_same and all(
            _is_yours(paths[n]) and _has(paths[n], c) for n, c in code.items()
        )
        differing = [p for n, p in paths.items() if is_file(p) and not _has(p, files[n])]
        edited = [os.path.relpath(path) for path in differing]
    return Programs(commands=commands, files=list(code), is_yours=has_all, edited=edited)


def _words(given: Mapping[str, Any], *, own_program: bool) -> list[str]:
    """Return the program of a participant, and what its parameters name that would be executed.

    These are classes, as `law`; files outside of the recording, such as an FMU; and the parameter
    `command`, a command line. What installed packages declare is left out. own_program: so is the
    program.
    """
    program = given.get("exec") or given.get("participant") or []
    words = list(map(str, program)) if isinstance(program, list) else [str(program)]
    is_installed_class = "exec" not in given and program in participant_classes()
    if own_program or is_installed_class:
        words = []
    params = given.get("params")
    texts = (text for _, text in texts_in(params))
    started = params.get("command") if isinstance(params, Mapping) else None
    return [*words, *filter(_is_foreign, texts), *(text for _, text in texts_in(started))]


def _is_foreign(text: str) -> bool:
    """Return whether a text names a class that is not installed, or a program by its whole path."""
    path = PurePosixPath(text)
    if path.is_absolute() and path.suffix and path.suffix.lower() not in _DATA:
        return True
    module, _, attribute = text.partition(":")
    is_class = attribute.isidentifier() and all(map(str.isidentifier, module.split(".")))
    return is_class and not is_installed(module)


def _is_shipped(name: str, content: bytes) -> bool:
    """Return whether a file is that of an installed scenario."""
    return any(
        _has(scenario / name, content)
        for folder in scenario_folders().values()
        for scenario in folder.iterdir()
    )


def _has(path: Path, content: bytes) -> bool:
    try:
        return read_file(path) == content
    except OSError:
        return False
