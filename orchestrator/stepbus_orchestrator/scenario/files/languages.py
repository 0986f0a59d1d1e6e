"""Which files of a scenario's folder a program loads that its command line does not name."""

import os
import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

from stepbus_participant import open_regular

from .paths import BUILT, is_file, is_folder

_BY_LANGUAGE = {
    "awk": ("*.awk",),
    "guile": ("*.scm",),
    "julia": ("*.jl", "Project.toml", "Manifest.toml"),
    "lua": ("*.lua",),
    "node": ("package.json",),
    "octave": ("*.m",),
    "perl": ("*.pm", "*.pl"),
    "php": ("*.php",),
    "python": (),
    "rscript": ("*.R", "*.r"),
    "ruby": ("*.rb",),
    "tclsh": ("*.tcl",),
}
"""Language → what its programs load from below the folder of their script."""

_ALSO = {"gawk": "awk", "luajit": "lua", "octave-cli": "octave", "nodejs": "node", "pypy": "python"}
_VERSION = re.compile(r"[-.\d]+$")
_CLASS_PATHS = ("-cp", "-classpath", "--class-path", "-p", "--module-path")
_MOST = 500
"""A folder with more of them is no program's own: they have to be declared."""


def language(words: Sequence[str], folder: Path) -> str:
    """Return the language of a command line's program; empty where it has none of its own."""
    name = Path(words[0]).name
    script = folder / words[0]
    if is_file(script) and not _is_link_out(script, folder):
        name = _interpreter(script) or name
    name = name.lower()
    name = _ALSO.get(name, name)
    name = name if name in _BY_LANGUAGE else _VERSION.sub("", name)
    name = _ALSO.get(name, name)
    return name if name in _BY_LANGUAGE or name == "java" else ""


def loaded_files(words: Sequence[str], folder: Path) -> Iterator[Path]:
    """Yield what a program loads from the folder, by the rules of its language."""
    name = language(words, folder) if words else ""
    if name == "java":
        yield from _class_path(words, folder)
    patterns = _BY_LANGUAGE.get(name, ())
    script = next((folder / word for word in words if is_file(folder / word)), None)
    if not patterns or script is None:
        return
    found = [path for path in _below(script.parent) if any(map(path.match, patterns))]
    if len(found) > _MOST:
        found = [path for path in found if path.parent == script.parent]
    yield from found[:_MOST]


def declared_files(pattern: str, folder: Path) -> list[Path]:
    """Return the files of a pattern of `files`, or all below it where it is a folder; sorted."""
    try:
        found = sorted(folder.glob(pattern))
    except (NotImplementedError, ValueError):
        return []
    inside = [path for path in found if is_file(path)]
    return inside + [path for top in found if is_folder(top) for path in _all_below(top)]


def is_virtual(program: Path) -> bool:
    """Return whether a program belongs to a virtual environment of Python."""
    return is_file(program.parent.parent / "pyvenv.cfg")


def _is_link_out(path: Path, folder: Path) -> bool:
    return path.is_symlink() and not path.resolve().is_relative_to(folder.resolve())


def _interpreter(script: Path) -> str:
    """Return the interpreter that the first line of a script names; empty without one."""
    try:
        with os.fdopen(open_regular(script), "rb") as file:
            first = file.readline(200)
    except OSError:
        return ""
    if not first.startswith(b"#!"):
        return ""
    words = first[2:].decode(errors="replace").split()
    names = [Path(word).name for word in words if not word.startswith("-")]
    return next((name for name in names if name != "env"), "")


def _class_path(words: Sequence[str], folder: Path) -> Iterator[Path]:
    values = [after for word, after in pairwise(words) if word in _CLASS_PATHS]
    values += [word.partition("=")[2] for word in words if word.startswith("--class-path=")]
    for entry in (entry for value in values for entry in value.split(os.pathsep) if entry):
        path = folder / entry
        if Path(entry).name == "*":
            yield from sorted(path.parent.glob("*.jar"))
        elif is_file(path):
            yield path
        elif is_folder(path):
            yield from _all_below(path) if path != folder else sorted(path.glob("*.class"))


def _all_below(folder: Path) -> list[Path]:
    return [
        path
        for path in sorted(folder.rglob("*"))
        if is_file(path) and "__pycache__" not in path.parts
    ]


def _below(folder: Path) -> Iterator[Path]:
    """Yield the files below a folder, but for those that are made or hidden."""
    for top, folders, names in os.walk(folder):
        folders[:] = sorted(n for n in folders if n not in BUILT and not n.startswith("."))
        yield from (Path(top, name) for name in sorted(names))
