"""Questions to the file system that never raise: what cannot be reached is not there."""

import re
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
