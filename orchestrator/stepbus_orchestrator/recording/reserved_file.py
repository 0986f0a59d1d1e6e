"""A file that a full disk cannot corrupt, and that others can see is being written."""

import contextlib
import fcntl
import os
import struct
from collections.abc import Sequence
from pathlib import Path

from isal.isal_zlib import crc32

from stepbus_orchestrator.recording.records import HEAD
from stepbus_participant import Disk, make_file, write_at, write_parts_at

_END_BYTES = 256 * 1024
"""For the end of a file beside the index of its chunks: channels, schemas, statistics."""
_MORE_BYTES = 256 * 1024
_BLOCK_BYTES = 1024 * 1024
_COVER = 0x80
"""A record of this type is skipped by every reader of MCAP."""


class ReservedFile:
    """An append-only file of complete writes: one that fails leaves nothing behind.

    A reserve of 512 KiB, or more where `keep_room` asks for it, is given back by `release`: room to
    close the file properly, so that a recording on a full disk ends with its index. It is a
    file without a name, so that it goes with the process, however that ends. Until it is closed, it
    is locked as one that is being written.

    disk: of the run. position: how much has been written [bytes]. All methods raise OSError.
    """

    def __init__(self, path: Path, disk: Disk = os) -> None:
        self._path = path
        self._disk = disk
        self.position = 0
        self._ahead = 0
        self._reserve = -1
        self._reserved = 0
        # A named pipe that stands there would wait for a reader without O_NONBLOCK.
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOFOLLOW
        self._file = disk.open(path, flags, 0o644)
        status = os.fstat(self._file)
        self._identity = (status.st_dev, status.st_ino)
        _set_lock(self._file, fcntl.F_WRLCK)
        try:
            name = path.with_name(f".{path.name}.reserve")
            self._reserve = make_file(name, 0o600, disk)
            disk.unlink(name)
            self.keep_room(0)
        except OSError:
            self._disk.close(self._file)
            self.release()
            raise

    def keep_room(self, size: int) -> None:
        """Keep room for an index of so many bytes."""
        if self._reserve >= 0 and _END_BYTES + size > self._reserved:
            reserved = _END_BYTES + size + _MORE_BYTES
            self._disk.posix_fallocate(self._reserve, self._reserved, reserved - self._reserved)
            self._reserved = reserved

    def write(self, parts: Sequence[bytes], ahead: bytes = b"") -> None:
        """Append all parts, or nothing of them; ahead: what the next `write` replaces."""
        size = sum(map(len, parts))
        over = self._ahead - size - len(ahead)
        # A process that is killed here leaves no rubbish behind them, but one private record.
        cover = HEAD.pack(_COVER, max(0, over - HEAD.size)) if over > 0 else b""
        try:
            write_parts_at(self._disk, self._file, (*parts, ahead, cover), self.position)
            if cover:
                self._disk.ftruncate(self._file, self.position + size + len(ahead))
        except OSError:
            self._ahead = 0
            self._disk.ftruncate(self._file, self.position)
            raise
        self._ahead = len(ahead)
        self.position += size

    def write_ahead(self, data: bytes) -> bool:
        """Append bytes that the next `write` replaces; return whether there was room for them."""
        end = self.position + self._ahead
        try:
            write_at(self._disk, self._file, data, end)
        except OSError:
            with contextlib.suppress(OSError):
                self._disk.ftruncate(self._file, end)
            return False
        self._ahead += len(data)
        return True

    def changed(self, crc: int) -> str:
        """Return what another process did to the closed file; empty when it holds what was written.

        crc: of that. It reads the whole file.
        """
        try:
            status = self._path.stat()
            # Before it is opened: opening a pipe waits for its other end.
            if (status.st_dev, status.st_ino) != self._identity:
                return "was replaced by another file"
            with self._path.open("rb") as file:
                found = 0
                while block := file.read(_BLOCK_BYTES):
                    found = crc32(block, found)
        except (FileNotFoundError, NotADirectoryError):
            return "was removed"
        return "" if found == crc else "has other content than was written"

    def release(self) -> None:
        """Give back the room that was set aside."""
        if self._reserve >= 0:
            reserve, self._reserve = self._reserve, -1
            # It holds nothing, and is closed also where that reports an error.
            with contextlib.suppress(OSError):
                self._disk.close(reserve)

    def close(self) -> None:
        """Close the file; to be called once."""
        # Also for children that have inherited it.
        _set_lock(self._file, fcntl.F_UNLCK)
        with contextlib.suppress(OSError):
            self._disk.close(self._file)


_LOCK = struct.Struct("hhqqi0q")
"""`struct flock`: type, whence, start, length, process. A lock of an open file (OFD): unlike one of
a process, it does not end when that process opens and closes the same file once more."""


def _set_lock(file: int, kind: int) -> None:
    # Where the file system has no locks, no other process sees that the file is being written.
    with contextlib.suppress(OSError):
        fcntl.fcntl(file, fcntl.F_OFD_SETLK, _LOCK.pack(kind, os.SEEK_SET, 0, 0, 0))


def is_locked(file: int) -> bool:
    """Return whether another process, or this one, is writing a file. file: a descriptor."""
    try:
        question = _LOCK.pack(fcntl.F_RDLCK, os.SEEK_SET, 0, 0, 0)
        answer = fcntl.fcntl(file, fcntl.F_OFD_GETLK, question)
    except OSError:
        return False
    kind: int = _LOCK.unpack(answer)[0]
    return kind != fcntl.F_UNLCK
