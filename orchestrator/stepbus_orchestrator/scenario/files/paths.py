"""Questions to the file system that never raise: what cannot be reached is not there."""

from pathlib import Path


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
