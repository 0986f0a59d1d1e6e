"""The files a scenario names, and those which these name in turn."""

import os
import re
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_orchestrator.scenario.names import FileUnreadable, modules_in, names_in
from stepbus_orchestrator.scenario.paths import (
    all_below,
    declared_files,
    is_file,
    is_folder,
    is_virtual,
    own_below,
)
from stepbus_orchestrator.scenario.program import python_target
from stepbus_participant import is_installed, open_regular, package_path, read_text
from stepbus_participant.parameters import Keys
from stepbus_schemas import WiringError

IGNORE_FILE = ".stepbusignore"
"""Beside the scenario: patterns of files that are not recorded with a script, a line each."""
_MOST = 500
_MOST_BYTES = 16 << 20
_PYTHON = re.compile(r"(python|pypy)[-.\d]*$")
_CLASS = re.compile(r"([A-Za-z_][\w.]*):[A-Za-z_][\w.]*")


@dataclass
class FileSearch:
    """What a search has found.

    found: path relative to the scenario's folder, with `/`, and `..` where it is in a folder
    beside or above → file. mistakes: values of the scenario whose file cannot be found from a copy
    of all these, or cannot be read. left_out: what lies in the folder and cannot be copied from
    it, a sentence each.
    """

    folder: Path
    files: dict[str, Path] = field(default_factory=dict)
    mistakes: list[tuple[Keys, str]] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    _queue: deque[tuple[Keys, Path]] = field(default_factory=deque)

    def name(self, keys: Keys, text: str, bases: list[Path], *, program: bool = False) -> None:
        """Look for the file that a text names. bases: folders it may be relative to."""
        if text.startswith("package://"):
            self._package(keys, text, bases)
        if not text or "://" in text:
            return
        paths = ((base, _normal(base / text)) for base in bases)
        base, path = next(((b, at) for b, at in paths if is_file(at)), (self.folder, None))
        if path is None or (program and os.access(path, os.X_OK) and self._is_outside(path)):
            return
        if program and is_virtual(path):
            if not Path(text).is_absolute():
                self.left_out.append(
                    f"{text}: a virtual environment is not recorded; write its absolute path, and "
                    "a rerun on this machine finds it"
                )
            return
        # In a copy, the folders above the scenario's have other names.
        if os.path.normpath(Path(self._relative(base)) / text) != self._relative(path):
            self.mistakes.append((keys, _copy_message(text, os.path.relpath(path, base))))
        else:
            self._take(keys, path)

    def _package(self, keys: Keys, url: str, bases: list[Path]) -> None:
        """Look for the file of a package that is not installed, but a folder of the user's."""
        if _package_file(url) is not None:
            return
        path = next((at for base in bases if (at := _package_file(url, base)) is not None), None)
        if path is not None:
            self._take(keys, _normal(path))

    def module(self, keys: Keys, module: str, bases: list[Path]) -> None:
        """Look for the Python file, or the files of the package, that a module's name means."""
        top = module.partition(".")[0]
        if is_installed(module):
            return
        for base in bases:
            if is_file(base / f"{top}.py"):
                self._take(keys, base / f"{top}.py")
                return
            package = base / top
            if is_folder(package) and package != self.folder:
                for path in sorted(package.rglob("*.py")):
                    self._take(keys, path)
                return

    def take(self, paths: Iterable[Path]) -> None:
        """Take files as they are, without a search for what they name."""
        for path in map(_normal, paths):
            self.files.setdefault(self._relative(path), path)

    def run(self) -> None:
        """Read the files found so far for further names, and so on."""
        while self._queue:
            keys, path = self._queue.popleft()
            bases = list(dict.fromkeys((path.parent, self.folder)))
            try:
                for text in names_in(path):
                    self.name(keys, text, bases)
                    self._class(keys, text, bases)
                for module in modules_in(path):
                    self.module(keys, module, bases)
            except FileUnreadable as exc:
                self.mistakes.append((keys, f"{self._relative(path)}{exc}"))

    def value(self, keys: Keys, value: Any) -> None:
        """Check every text in a value of `params`."""
        if isinstance(value, dict):
            for key, item in value.items():
                self.value((*keys, key), item)
        elif isinstance(value, list):
            for index, item in enumerate(value):
                self.value((*keys, index), item)
        elif isinstance(value, str):
            self.name(keys, value, [self.folder])
            self._class(keys, value, [self.folder])

    def _class(self, keys: Keys, text: str, bases: list[Path]) -> None:
        form = _CLASS.fullmatch(text)
        if form is not None:
            self.module(keys, form[1], bases)

    def _take(self, keys: Keys, path: Path) -> None:
        name = self._relative(path)
        if name not in self.files:
            self.files[name] = path
            self._queue.append((keys, path))

    def _is_outside(self, path: Path) -> bool:
        return not path.is_relative_to(self.folder)

    def _relative(self, path: Path) -> str:
        return Path(os.path.relpath(path, self.folder)).as_posix()


def _package_file(url: str, folder: Path | None = None) -> Path | None:
    try:
        return package_path(url, folder)
    except WiringError:
        return None


def _copy_message(text: str, relative: str) -> str:
    return (
        f"write {text!r} as {relative!r}: a recording is run again from a copy of these files, "
        "in which folders above the scenario's have other names"
    )


def search_files(scenario: Scenario) -> FileSearch:
    """Return the files of a scenario: in `types`, `exec` and `params`, and those named in these."""
    search = FileSearch(folder=scenario.folder)
    for path in scenario.type_files:
        search.name(("types",), path, [scenario.folder])
    for spec in scenario.participants:
        for keys, text, program in _words(spec):
            search.name(keys, text, [scenario.folder], program=program)
        row: Keys = ("participants", spec.name)
        source = spec.participant.rpartition(":")[0]
        if source.endswith(".py"):
            search.name((*row, "participant"), source, [scenario.folder])
        elif source:
            search.module((*row, "participant"), source, [scenario.folder])
        for words in filter(None, (spec.exec, _bridged(spec.exec))):
            if _PYTHON.match(Path(words[0]).name):
                launch, name = python_target(words[1:])
                if launch == "module":
                    search.module((*row, "exec"), name, [scenario.folder])
        search.value(("participants", spec.name, "params"), spec.params)
    search.run()
    for spec in scenario.participants:
        _take_loaded(search, spec)
    return search


def _take_loaded(search: FileSearch, spec: ParticipantSpec) -> None:
    """Take what a program may load and nothing names, and what is declared."""
    for words in filter(None, (spec.exec, _bridged(spec.exec))):
        _take_beside(search, spec, words)
    for index, pattern in enumerate(spec.files):
        paths = declared_files(pattern, search.folder)
        if not paths:
            keys: Keys = ("participants", spec.name, "files", index)
            search.mistakes.append((keys, f"no file matches {pattern!r} in {search.folder}"))
        search.take(paths)


def _take_beside(search: FileSearch, spec: ParticipantSpec, words: tuple[str, ...]) -> None:
    """Take what lies beside a script, and below the folders that its command line names.

    What Python imports is known better. A class path has several folders, with `:` between them.
    """
    folder = search.folder
    for word in words:
        entries = word.removeprefix("-I").split(os.pathsep)
        for path in (folder / entry.removesuffix("*") for entry in entries if entry):
            if is_folder(path) and path != folder and path.is_relative_to(folder):
                search.take(all_below(path))
            elif len(entries) > 1 and is_file(path) and path.is_relative_to(folder):
                search.take([path])
    script = next((folder / word for word in words if is_file(folder / word)), None)
    if script is None or _PYTHON.match(Path(words[0]).name) or not _is_text(script):
        return
    ignored = _lines(folder / IGNORE_FILE)
    files = list(own_below(script.parent, ignored))
    if len(files) > _MOST or sum(path.stat().st_size for path in files) > _MOST_BYTES:
        search.left_out.append(
            f"what lies beside {script.relative_to(folder)}: more than {_MOST} files, or "
            f"{_MOST_BYTES >> 20} MiB; declare those of participants.{spec.name} in `files`, or "
            f"name others in {IGNORE_FILE}"
        )
        return
    search.take(files)


def _is_text(script: Path) -> bool:
    """Return whether an interpreter reads a program; a compiled one loads nothing beside it."""
    try:
        with os.fdopen(open_regular(script), "rb") as file:
            return b"\0" not in file.read(1024)
    except OSError:
        return False


def _lines(path: Path) -> list[str]:
    try:
        lines = read_text(path).splitlines()
    except (OSError, UnicodeDecodeError):
        return []
    return [line.strip().removesuffix("/") for line in lines if line.strip() and line[0] != "#"]


def _bridged(words: tuple[str, ...]) -> tuple[str, ...]:
    """Return the program behind `stepbus bridge … --`; empty where there is none."""
    is_bridge = words[:2] == ("stepbus", "bridge") and "--" in words
    return words[words.index("--") + 1 :] if is_bridge else ()


def _words(spec: ParticipantSpec) -> Iterator[tuple[Keys, str, bool]]:
    """Return the words of a command that may name a file, and whether it may be a program."""
    for index, word in enumerate(spec.exec):
        keys: Keys = ("participants", spec.name, "exec", index)
        yield keys, word, True
        if word.startswith("-") and "=" in word:
            yield keys, word.partition("=")[2], False


def _normal(path: Path) -> Path:
    # Not resolve(): what a link of the folder points to may lie outside, the link itself does not.
    return Path(os.path.normpath(path))
