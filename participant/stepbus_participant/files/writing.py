"""Makes files and folders of a run: new ones, whatever others have put in their place.

In a folder that others may write to, a link that they have planted would lead somewhere else; and
with a umask of 0, what a run makes would be theirs to change.
"""

import contextlib
import errno
import itertools
import os
import stat
from collections.abc import Callable, Mapping
from pathlib import Path

_FOLDER_MODE = 0o755
_FILE_MODE = 0o644


def make_folder(path: Path) -> None:
    """Make a folder and those above it, which only their owner may write to.

    Harmless where it is there. Raises OSError, also where something else has its name.
    """
    missing = list(itertools.takewhile(lambda each: not each.exists(), (path, *path.parents)))
    for folder in reversed(missing):
        with contextlib.suppress(FileExistsError):
            folder.mkdir(_FOLDER_MODE)
    if not path.is_dir():
        raise FileExistsError(errno.EEXIST, "there is something else of that name", str(path))


def make_new_folder(path: Path) -> None:
    """Make a folder that is not there yet; raises FileExistsError where anything is."""
    make_folder(path.parent)
    path.mkdir(_FOLDER_MODE)


def make_file(path: Path, mode: int = _FILE_MODE) -> int:
    """Return a descriptor of a new, empty file, to read and write; what had its name is removed.

    A link is not followed. Raises OSError.
    """
    with contextlib.suppress(FileNotFoundError):
        path.unlink()
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    return os.open(path, flags, mode)


def append_to(path: Path) -> int:
    """Return a descriptor to read a file and append to it; it is made where it is missing.

    Raises OSError, also where a link has its name.
    """
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
    return os.open(path, flags, _FILE_MODE)


def write_file(path: Path, data: bytes, mode: int = _FILE_MODE) -> None:
    """Write a new file, in place of what had its name; raises OSError."""
    with os.fdopen(make_file(path, mode), "wb") as file:
        file.write(data)


def is_shared(folder: Path) -> bool:
    """Return whether every user of the machine may write to a folder."""
    with contextlib.suppress(OSError):
        return bool(folder.stat().st_mode & stat.S_IWOTH)
    return False


_KINDS: Mapping[str, Callable[[int], bool]] = {
    "a folder": stat.S_ISDIR,
    "a link": stat.S_ISLNK,
    "a named pipe": stat.S_ISFIFO,
    "a socket": stat.S_ISSOCK,
}


def irregular(path: Path) -> str:
    """Return what is there that no file must take the place of; empty for a file, or nothing."""
    try:
        mode = path.lstat().st_mode
    except OSError:
        return ""
    if stat.S_ISREG(mode):
        return ""
    return next((kind for kind, fits in _KINDS.items() if fits(mode)), "a device")
