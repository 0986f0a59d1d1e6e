"""The disk of a simulated run: real files in memory, and what may go wrong with them."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from .world import Process

# Beside the disk, simulated code writes no file: these are the functions that do.
_open, _replace = os.open, os.replace

Strike = Callable[[str, int], int]
"""Takes the name of a call and its size [bytes]; raises OSError, or returns what a write takes."""


class SimulatedDisk:
    """A `Disk` of one process, which ends with it: nothing more is written, all files are closed.

    strike: what goes wrong before a call. done: is called with its name after it.
    """

    def __init__(self, process: Process) -> None:
        self.strike: Strike = lambda _name, size: size
        self.done: Callable[[str], None] = lambda _name: None
        self._process = process
        self._open: set[int] = set()
        process.on_end.append(self._close_all)

    def _close_all(self) -> None:
        for descriptor in self._open:
            os.close(descriptor)
        self._open.clear()

    def _do(self, name: str, size: int) -> int:
        self._process.call()
        size = self.strike(name, size)
        self._process.world.note(f"disk: {name} of {size} bytes")
        return size

    def open(self, path: Path, flags: int, mode: int = 0o777) -> int:
        """Return a descriptor."""
        self._do("open", 0)
        descriptor = _open(path, flags, mode)
        self._open.add(descriptor)
        return descriptor

    def pwritev(self, fd: int, parts: Sequence[bytes | memoryview], offset: int, /) -> int:
        """Write parts at an offset; return how many bytes, which may be fewer."""
        if self._process.is_dead:
            return sum(map(len, parts))
        data = b"".join(parts)
        size = self._do("pwrite", len(data))
        written = os.pwrite(fd, memoryview(data)[:size], offset)
        self.done("pwrite")
        return written

    def ftruncate(self, fd: int, length: int, /) -> None:
        """Cut a file [bytes]."""
        if not self._process.is_dead:
            self._do("ftruncate", 0)
            os.ftruncate(fd, length)

    def posix_fallocate(self, fd: int, offset: int, length: int, /) -> None:
        """Set room aside [bytes]."""
        if not self._process.is_dead:
            self._do("posix_fallocate", 0)

    def fsync(self, fd: int) -> None:
        """Bring a file to the medium."""
        if not self._process.is_dead:
            self._do("fsync", 0)

    def close(self, fd: int) -> None:
        """Close a descriptor; it is closed also where that reports an error."""
        if fd in self._open:
            self._open.discard(fd)
            os.close(fd)
            self._do("close", 0)

    def replace(self, src: Path, dst: Path) -> None:
        """Rename a file, in place of what has the name."""
        if not self._process.is_dead:
            self._do("replace", 0)
            _replace(src, dst)

    def unlink(self, path: Path) -> None:
        """Remove a file."""
        if not self._process.is_dead:
            self._do("unlink", 0)
            Path(path).unlink()
