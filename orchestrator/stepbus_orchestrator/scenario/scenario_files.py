"""Which files belong to a run, so that it can be repeated from its recording alone.

They are those that the scenario names, all in the folder where they lie, and what participants
declare in `files`. The folder is the scenario's own; of a file beside or above that, such as
`../models/urdf/arm.urdf`, it is the one beside it, `../models`.
"""

import contextlib
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import file_in, is_installed, package_path, read_file
from stepbus_participant.parameters import Keys
from stepbus_schemas import WiringError

IGNORE_FILE = ".stepbusignore"
"""In a folder: patterns of files and folders in it that are not recorded, a line each."""
_MOST_FILES, _MOST_BYTES = 500, 16 << 20
"""Of a folder with more, only what is named is recorded."""
BUILT = ("__pycache__", "build", "node_modules", "runs", "site-packages", "sweeps", "target")
"""Folders of what is installed, cached, built or recorded."""
_IGNORED = (*BUILT, ".*", "*.ipynb", "*.log", "*.mcap", "*.md")
MARKS = {"pyvenv.cfg", "sweep.json", "timing.mcap"}
"""A folder that has one of these is a virtual environment, a sweep or a run."""
_SCENARIO = re.compile(r"^(participants|extends)[ \t]*:", re.MULTILINE)
_URL = re.compile(r"(?:package|model)://([\w.-]+/[^\s\"'<>,\]})]+)")
_NAMING = (".sdf", ".srdf", ".urdf", ".xacro", ".xml", ".yaml", ".yml")
"""Files in which `package://` names others, or `model://`, as it is called in SDF."""


@dataclass
class Files:
    """The files of a run.

    paths: name → file; the name is relative to the scenario's folder, with `/`, and with `..` where
    the file is in a folder beside or above. problems: values of the scenario whose file cannot be
    found from a copy of all these. left_out: what a rerun does not find, a sentence each.
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

    def root(self, path: Path) -> Path:
        """Return the folder that a file brings: the scenario's, or else the one beside it."""
        parts = Path(self.name(path)).parts
        above = parts.count("..")
        return self.folder.joinpath(*parts[: above + (len(parts) > above + 1)] if above else ())


def find_files(scenario: Scenario) -> Files:
    """Return the files of a scenario."""
    files = Files(folder=scenario.folder)
    roots: list[Path] = []
    for keys, text, is_program in _texts(scenario):
        if path := _named(files, keys, text, is_program=is_program):
            files.take([path])
            roots.append(files.root(path))
        elif _is_module(text, files.folder):
            roots.append(files.folder)
    taken: set[Path] = set()
    while new := set(roots) - taken:
        for root in sorted(new):
            _take_folder(files, root, warns=not any(spec.files for spec in scenario.participants))
        taken |= new
        roots = [files.root(path) for path in _package_files(files.paths.values())]
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
            if word.startswith("-") and "=" in word:
                yield (*row, "exec", index), word.partition("=")[2], False
        texts = _texts_in(spec.params, (*row, "params"))
        yield from ((keys, file_in(text), False) for keys, text in texts)


def _texts_in(value: Any, keys: Keys) -> Iterator[tuple[Keys, str]]:
    if isinstance(value, str):
        yield keys, value
    elif isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _texts_in(item, (*keys, key))


def _is_module(text: str, folder: Path) -> bool:
    """Return whether a text may be a Python module of a folder, or a class in one."""
    top = re.split("[.:]", text)[0]
    is_there = is_file(folder / f"{top}.py") or is_folder(folder / top)
    return top.isidentifier() and is_there and not is_installed(top)


def _named(files: Files, keys: Keys, text: str, *, is_program: bool) -> Path | None:
    """Return the file that a text names; None where it names none, or one that is not recorded."""
    if text.startswith("package://"):
        return _package_file(text, files.folder)
    # Not resolve(): what a link of the folder points to may lie outside, the link itself does not.
    path = Path(os.path.normpath(files.folder / text))
    if not text or "://" in text or not is_file(path):
        return None
    if is_program and is_in_environment(path):
        if not Path(text).is_absolute():
            files.left_out.append(
                f"{text}: a virtual environment is not recorded; write its absolute path "
                "so that a rerun on this machine finds it"
            )
        return None
    if is_program and os.access(path, os.X_OK) and not path.is_relative_to(files.folder):
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


def _package_files(paths: Iterable[Path]) -> Iterator[Path]:
    """Yield the files of the user's packages that others name by `package://`."""
    for path in (path for path in paths if path.suffix.lower() in _NAMING):
        urls = dict.fromkeys(_URL.findall(_text(path)))
        files = (_package_file(f"package://{url}", path.parent) for url in urls)
        yield from (file for file in files if file is not None)


def _text(path: Path) -> str:
    """Return the text of a file; nothing of one that cannot be read, or is too large for one."""
    try:
        return read_file(path, _MOST_BYTES).decode(errors="replace")
    except OSError:
        return ""


def _package_file(url: str, folder: Path) -> Path | None:
    """Return the file of a package that is a folder of the user's, and not installed."""
    with contextlib.suppress(WiringError):
        package_path(url)
        return None
    with contextlib.suppress(WiringError):
        return Path(os.path.normpath(package_path(url, folder)))
    return None


def _take_folder(files: Files, root: Path, *, warns: bool) -> None:
    """Take what is in a folder, but for what is ignored; nothing where that is too much."""
    ignored = (*_IGNORED, *_patterns(root / IGNORE_FILE))
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
            if warns:
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


def _patterns(path: Path) -> list[str]:
    lines = (line.strip() for line in _text(path).splitlines())
    return [line.removesuffix("/") for line in lines if line and line[0] != "#"]


def _take_declared(files: Files, spec: ParticipantSpec) -> None:
    """Take what a participant declares, and the folders in the scenario's that a command names."""
    entries = (entry for word in spec.exec for entry in word.split(os.pathsep))
    for folder in (files.folder / entry for entry in entries if entry):
        if is_folder(folder) and folder != files.folder and folder.is_relative_to(files.folder):
            files.take(_all_below(folder))
    for index, pattern in enumerate(spec.files):
        try:
            matches = sorted(files.folder.glob(pattern))
        except (NotImplementedError, ValueError):
            matches = []
        paths = [path for top in matches for path in ([top] if is_file(top) else _all_below(top))]
        if not paths:
            keys: Keys = ("participants", spec.name, "files", index)
            files.problems.append((keys, f"no file matches {pattern!r} in {files.folder}"))
        files.take(paths)


def _all_below(folder: Path) -> list[Path]:
    """Return the files below a folder, sorted; without what Python has compiled."""
    return [p for p in sorted(folder.rglob("*")) if is_file(p) and "__pycache__" not in p.parts]


def is_file(path: Path) -> bool:
    """Return whether there is a file; not for names too long, or folders that may not be read."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_in_environment(path: Path) -> bool:
    """Return whether a program is in a virtual environment."""
    return is_file(path.parent.parent / "pyvenv.cfg")


def is_folder(path: Path) -> bool:
    """Return whether there is a folder; likewise."""
    try:
        return path.is_dir()
    except OSError:
        return False


def is_scenario(path: Path) -> bool:
    """Return whether a YAML file has the keys of a scenario, or of a part of one."""
    is_yaml = path.suffix in {".yaml", ".yml"} and is_file(path)
    return is_yaml and _SCENARIO.search(_text(path)) is not None
