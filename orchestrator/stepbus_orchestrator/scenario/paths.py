"""Questions to the file system that never raise: what cannot be reached is not there."""

import os
import re
from collections.abc import Iterator, Sequence
from fnmatch import fnmatch
from pathlib import Path

from stepbus_participant import read_file

INSTALLED = frozenset({"__pycache__", "node_modules", "runs", "site-packages"})
"""Folders of what is installed, cached, or recorded: no files of a scenario's own."""

BUILT = INSTALLED | {"build", "target"}
"""These, and folders of what is built from source."""

_SCENARIO = re.compile(rb"^(participants|extends)[ \t]*:", re.MULTILINE)


def is_file(path: Path) -> bool:
    """Return whether there is a file; not for names too long, or folders that may not be read."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_folder(path: Path) -> bool:
    """Return whether there is a folder; likewise."""
    try:
        return path.is_dir()
    except OSError:
        return False


def is_scenario(path: Path) -> bool:
    """Return whether a file has the keys of a scenario, or of a part of one."""
    try:
        return is_file(path) and _SCENARIO.search(read_file(path)) is not None
    except OSError:
        return False


def is_virtual(program: Path) -> bool:
    """Return whether a program belongs to a virtual environment of Python."""
    return is_file(program.parent.parent / "pyvenv.cfg")


def all_below(folder: Path) -> list[Path]:
    """Return the files below a folder, sorted; without what Python has compiled."""
    return [p for p in sorted(folder.rglob("*")) if is_file(p) and "__pycache__" not in p.parts]


def own_below(folder: Path, ignored: Sequence[str] = ()) -> Iterator[Path]:
    """Yield the files below a folder, but for those that are hidden, built, or of a run.

    ignored: patterns of names, or of paths relative to the folder.
    """
    for top, folders, names in os.walk(folder):
        if "timing.mcap" in names:
            folders.clear()
            continue
        folders[:] = sorted(n for n in folders if n not in BUILT and not n.startswith("."))
        for path in (Path(top, name) for name in sorted(names) if not name.startswith(".")):
            where = path.relative_to(folder).as_posix()
            is_ignored = any(fnmatch(path.name, p) or fnmatch(where, p) for p in ignored)
            if not is_ignored and path.suffix != ".mcap" and not is_scenario(path):
                yield path


def declared_files(pattern: str, folder: Path) -> list[Path]:
    """Return the files of a pattern of `files`, or all below it where it is a folder; sorted."""
    try:
        matches = sorted(folder.glob(pattern))
    except (NotImplementedError, ValueError):
        return []
    inside = [path for path in matches if is_file(path)]
    return inside + [path for top in matches if is_folder(top) for path in all_below(top)]
