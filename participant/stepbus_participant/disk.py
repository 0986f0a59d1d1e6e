"""Files and folders that are written, by way of a disk; a simulated one can take its place."""

import contextlib
import errno
import itertools
import os
import stat
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Protocol

_FOLDER_MODE = 0o755
_FILE_MODE = 0o644
_MOST_PARTS = 1024
"""That Linux writes in one go (IOV_MAX)."""


class Disk(Protocol):
    """Writes files; the module `os` is the real one. All methods raise OSError.

    Files are read past it: what stands in one is what has been written.
    """

    def open(self, path: Path, flags: int, mode: int = 0o777) -> int:
        """Return a descriptor."""

    def pwritev(self, fd: int, parts: Sequence[bytes | memoryview], offset: int, /) -> int:
        """Write parts at an offset, in one go; return how many bytes, which may be fewer."""

    def ftruncate(self, fd: int, length: int, /) -> None:
        """Cut a file [bytes]."""

    def posix_fallocate(self, fd: int, offset: int, length: int, /) -> None:
        """Set room aside [bytes]."""

    def fsync(self, fd: int) -> None:
        """Bring a file to the medium."""

    def close(self, fd: int) -> None:
        """Close a descriptor."""

    def replace(self, src: Path, dst: Path) -> None:
        """Rename a file, in place of what has the name."""

    def unlink(self, path: Path) -> None:
        """Remove a file."""


def make_folder(path: Path) -> None:
    """Make a folder and those above it, which only their owner may write to.

    Harmless where it is there. Raises OSError, also where something else has its name.
    """
    missing = list(itertools.takewhile(lambda each: not each.exists(), (path, *path.parents)))
    for folder in reversed(missing):
        with contextlib.suppress(FileExistsError):
            folder.mkdir(_FOLDER_MODE)
    if not path.is_dir():
        raise FileExistsError(errno.EEXIST, "exists and is not a folder", str(path))


def make_new_folder(path: Path) -> None:
    """Make a folder that is not there yet; raises FileExistsError where anything is."""
    make_folder(path.parent)
    path.mkdir(_FOLDER_MODE)


def append_to(path: Path, disk: Disk = os) -> int:
    """Return a descriptor to read a file and append to it; it is made where it is missing.

    Raises OSError, also where a link has its name.
    """
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
    return disk.open(path, flags, _FILE_MODE)


def is_shared(folder: Path) -> bool:
    """Return whether every user of the machine may write to a folder."""
    with contextlib.suppress(OSError):
        return bool(folder.stat().st_mode & stat.S_IWOTH)
    return False


def irregular(path: Path) -> bool:
    """Return whether a folder, link, pipe or device is there, whose place no file must take."""
    try:
        return not stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False


def make_file(path: Path, mode: int = _FILE_MODE, disk: Disk = os) -> int:
    """Return a descriptor of a new, empty file, to read and write; what had its name is removed.

    A link is not followed. Raises OSError.
    """
    with contextlib.suppress(FileNotFoundError):
        disk.unlink(path)
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    return disk.open(path, flags, mode)


def write_parts_at(disk: Disk, fd: int, parts: Iterable[bytes], offset: int) -> None:
    """Write all parts, one after the other; raises OSError."""
    rest = [memoryview(part) for part in parts if part]
    while rest:
        count = disk.pwritev(fd, rest[:_MOST_PARTS], offset)
        offset += count
        while rest and count >= len(rest[0]):
            count -= len(rest.pop(0))
        if count:
            rest[0] = rest[0][count:]


@contextlib.contextmanager
def replaced(
    path: Path, disk: Disk = os, mode: int = _FILE_MODE, *, syncs: bool = False
) -> Iterator[Path]:
    """Yield the path of an empty file beside `path`, which takes its place when it is written.

    No reader sees half of it, and after an exception it is gone. syncs: whether it is on the medium
    by then. Raises OSError.
    """
    part = path.with_name(f".{path.name}.part")
    fd = make_file(part, mode, disk)
    try:
        yield part
        if syncs:
            disk.fsync(fd)
        disk.replace(part, path)
    except BaseException:
        with contextlib.suppress(OSError):
            disk.unlink(part)
        raise
    finally:
        disk.close(fd)


def write_file(path: Path, data: bytes, mode: int = _FILE_MODE, disk: Disk = os) -> None:
    """Write a new file, in place of what had its name; raises OSError."""
    with replaced(path, disk, mode) as part:
        fd = disk.open(part, os.O_WRONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
        try:
            write_parts_at(disk, fd, [data], 0)
        finally:
            disk.close(fd)
