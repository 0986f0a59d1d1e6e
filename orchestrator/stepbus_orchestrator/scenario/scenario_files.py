"""Which files belong to a run, so that it can be repeated from its recording alone.

They are those in the scenario's folder, those that the scenario names, and those that participants
declare in `files`.
"""

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from stepbus_orchestrator.plugins import scenario_reader
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import file_in, read_file
from stepbus_participant.parameters import Keys

IGNORE_FILE = ".stepbusignore"
"""In the scenario's folder: patterns of files and folders that are not recorded, a line each."""
_MOST_FILES, _MOST_BYTES = 500, 16 << 20
"""Of a folder with more, only what is named is recorded."""
BUILT = ("__pycache__", "build", "node_modules", "runs", "site-packages", "sweeps", "target")
"""Folders of what is installed, cached, built or recorded."""
_IGNORED = (*BUILT, ".*", "*.ipynb", "*.log", "*.mcap", "*.md")
WATCH_FILE = "stepbus-watch.js"
"""Beside the runs of a watch: names the newest one to its page."""
MARKS = {"pyvenv.cfg", "sweep.json", "timing.mcap", WATCH_FILE}
"""A folder that has one of these is a virtual environment, a sweep, a run or a watch."""
_SCENARIO = re.compile(r"^(participants|extends)[ \t]*:", re.MULTILINE)


@dataclass
class Files:
    """The files of a run.

    paths: name → file; the name is relative to the scenario's folder, with `/`, and with `..` where
    the file is in a folder beside or above. problems: (keys, message) of each value of the scenario
    whose file is not found from a copy of these. left_out: messages about files that a rerun lacks.
    """

    folder: Path
    paths: dict[str, Path] = field(default_factory=dict)
    problems: list[tuple[Keys, str]] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def take(self, paths: Iterable[Path]) -> None:
        """Add files under their names."""
        for path in paths:
            self.paths[self.name(path)] = path

    def name(self, path: Path) -> str:
        """Return a path relative to the scenario's folder."""
        return Path(os.path.relpath(path, self.folder)).as_posix()


def find_files(scenario: Scenario) -> Files:
    """Return the files of a scenario."""
    files = Files(folder=scenario.folder)
    # Beside a file of another tool may be anything.
    if scenario_reader(scenario.file.name) is None:
        _take_folder(files, is_declared=any(spec.files for spec in scenario.participants))
    for keys, text, is_program in _texts(scenario):
        if path := _named(files, keys, text, is_program=is_program):
            files.take([path])
    for spec in scenario.participants:
        _take_declared(files, spec)
    files.paths = dict(sorted(files.paths.items()))
    return files


def _texts(scenario: Scenario) -> Iterator[tuple[Keys, str, bool]]:
    """Yield the texts of a scenario that may name files, and whether each may be a program."""
    for name in scenario.type_files:
        yield ("types",), name, False
    for spec in scenario.participants:
        row: Keys = ("participants", spec.name)
        yield (*row, "participant"), file_in(spec.participant), False
        for index, word in enumerate(spec.exec):
            yield (*row, "exec", index), word, True
        texts = texts_in(spec.params, (*row, "params"))
        yield from ((keys, file_in(text), False) for keys, text in texts)


def texts_in(value: Any, keys: Keys = ()) -> Iterator[tuple[Keys, str]]:
    """Yield the texts in a value, each with its keys. keys: of the value itself."""
    if isinstance(value, str):
        yield keys, value
    elif isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from texts_in(item, (*keys, key))


def _named(files: Files, keys: Keys, text: str, *, is_program: bool) -> Path | None:
    """Return the file that a text names; None where it names none, or one that is not recorded."""
    # Not resolve(): what a link of the folder points to may lie outside, the link itself does not.
    path = Path(os.path.normpath(files.folder / text))
    if not text or "://" in text or not is_file(path):
        return None
    # A program of another folder, or of a virtual environment, is installed and not recorded.
    is_far = is_in_environment(path) or not path.is_relative_to(files.folder)
    if is_program and is_far and os.access(path, os.X_OK):
        return None
    # In a copy, the folders above the scenario's have other names.
    if os.path.normpath(text) != files.name(path):
        message = (
            f"write {text!r} as {files.name(path)!r}: a rerun uses a copy of these "
            "files, in which the folders above the scenario's have other names"
        )
        files.problems.append((keys, message))
        return None
    return path


def _text(path: Path) -> str:
    """Return the text of a file; nothing of one that cannot be read, or is too large for one."""
    try:
        return read_file(path, _MOST_BYTES).decode(errors="replace")
    except OSError:
        return ""


def _take_folder(files: Files, *, is_declared: bool) -> None:
    """Add the files of the scenario's folder that are not ignored; none if they are too large.

    is_declared: the scenario lists in `files` the files that its programs load.
    """
    root = files.folder
    lines = (line.strip() for line in _text(root / IGNORE_FILE).splitlines())
    own = (line.removesuffix("/") for line in lines if line and line[0] != "#")
    ignored = (*_IGNORED, *own)
    paths: list[Path] = []
    size = 0
    for top, folders, names in os.walk(root):
        if not MARKS.isdisjoint(names):
            folders.clear()
            continue
        where = Path(top)
        folders[:] = sorted(n for n in folders if not _is_ignored(where / n, root, ignored))
        below = [where / name for name in names if not _is_ignored(where / name, root, ignored)]
        paths += [p for p in below if is_file(p) and os.access(p, os.R_OK) and not is_scenario(p)]
        size += sum(path.stat().st_size for path in paths if path.parent == where)
        if len(paths) > _MOST_FILES or size > _MOST_BYTES:
            if not is_declared:
                files.left_out.append(
                    f"{root} has more than {_MOST_FILES} files or {_MOST_BYTES >> 20} "
                    "MiB to record; list what your programs load in `files` of a "
                    f"participant, or exclude the rest in {IGNORE_FILE}"
                )
            return
    files.take(paths)


def _is_ignored(path: Path, root: Path, patterns: Sequence[str]) -> bool:
    """Return whether a pattern fits, or a recording cannot hold the name."""
    names = (path.name, path.relative_to(root).as_posix())
    is_named = any(fnmatch(name, pattern) for name in names for pattern in patterns)
    return is_named or not path.name.isprintable()


def _take_declared(files: Files, spec: ParticipantSpec) -> None:
    """Take what a participant declares: files, and all that is in folders."""
    for index, pattern in enumerate(spec.files):
        try:
            matches = sorted(files.folder.glob(pattern))
        except (NotImplementedError, ValueError):
            matches = []
        below = (path for top in matches for path in ([top] if is_file(top) else top.rglob("*")))
        paths = [p for p in below if is_file(p) and "__pycache__" not in p.parts]
        if not paths:
            keys: Keys = ("participants", spec.name, "files", index)
            files.problems.append((keys, f"no file matches {pattern!r} in {files.folder}"))
        files.take(Path(os.path.normpath(path)) for path in paths)


def is_file(path: Path) -> bool:
    """Return whether there is a file; not for names too long, or folders that may not be read."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_in_environment(path: Path) -> bool:
    """Return whether a program is in a virtual environment."""
    return is_file(path.parent.parent / "pyvenv.cfg")


def is_scenario(path: Path) -> bool:
    """Return whether a YAML file has the keys of a scenario, or of a part of one."""
    is_yaml = path.suffix in {".yaml", ".yml"} and is_file(path)
    return is_yaml and _SCENARIO.search(_text(path)) is not None
