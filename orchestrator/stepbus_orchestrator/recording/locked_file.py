"""A file that a full disk cannot corrupt, and that others can see is being written."""

import contextlib
import fcntl
import os
from pathlib import Path

from isal.isal_zlib import crc32

from stepbus_orchestrator.recording.records import HEAD
from stepbus_participant import Disk, make_file, write_parts_at

_END_BYTES = 256 * 1024
"""For the end of a file beside the index of its chunks: channels, schemas, statistics."""
_MORE_BYTES = 256 * 1024
_BLOCK_BYTES = 1024 * 1024
_COVER = 0x80
"""A record of this type is skipped by every reader of MCAP."""


class LockedFile:
    """An append-only file of complete writes: one that fails leaves nothing behind.

    A reserve of 512 KiB, or more where `keep_room` asks for it, is given back by `release`: room to
    close the file with its index on a full disk. It is a file without a name, so that it goes with
    the process. Until it is closed, the file is locked as one that is being written.

    disk: of the run. position: how much has been written [bytes]. All methods raise OSError.
    """

    def __init__(self, path: Path, disk: Disk = os) -> None:
        self._path = path
        self._disk = disk
        self.position = 0
        self._ahead = 0
        self._reserve, self._reserved = -1, 0
        # A named pipe that stands there would wait for a reader without O_NONBLOCK.
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOFOLLOW
        self._file = disk.open(path, flags, 0o644)
        # Where the file system has no locks, no other process sees that the file is being written.
        with contextlib.suppress(OSError):
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
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

    def release(self) -> None:
        """Give back the room that was set aside."""
        if self._reserve >= 0:
            reserve, self._reserve = self._reserve, -1
            # It holds nothing, and is closed also where that reports an error.
            with contextlib.suppress(OSError):
                self._disk.close(reserve)

    def write(self, data: bytes, ahead: bytes = b"") -> None:
        """Append all of `data`, or nothing of it; ahead: what the next `write` replaces."""
        end = self.position + len(data)
        over = self.position + self._ahead - end - len(ahead)
        # A process that is killed here leaves no rubbish after them, but one private record.
        cover = HEAD.pack(_COVER, max(0, over - HEAD.size)) if over > 0 else b""
        try:
            write_parts_at(self._disk, self._file, (data, ahead, cover), self.position)
            if cover:
                self._disk.ftruncate(self._file, end + len(ahead))
        except OSError:
            self._ahead = 0
            self._disk.ftruncate(self._file, self.position)
            raise
        self._ahead = len(ahead)
        self.position = end

    def write_ahead(self, data: bytes) -> bool:
        """Append bytes that the next `write` replaces; return whether there was room for them."""
        end = self.position + self._ahead
        try:
            write_parts_at(self._disk, self._file, [data], end)
        except OSError:
            with contextlib.suppress(OSError):
                self._disk.ftruncate(self._file, end)
            return False
        self._ahead += len(data)
        return True

    def holds(self, crc: int) -> bool:
        """Return whether the closed file has this checksum; it reads the whole file."""
        found = 0
        # Opening a pipe would wait for its other end.
        if not self._path.is_file():
            return False
        with self._path.open("rb") as file:
            while block := file.read(_BLOCK_BYTES):
                found = crc32(block, found)
        return found == crc

    def close(self) -> None:
        """Close the file; to be called once."""
        # Also for children that have inherited it.
        with contextlib.suppress(OSError):
            fcntl.flock(self._file, fcntl.LOCK_UN)
        with contextlib.suppress(OSError):
            self._disk.close(self._file)


def is_locked(file: int) -> bool:
    """Return whether another process, or this one, is writing a file. file: a descriptor."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        fcntl.flock(file, fcntl.LOCK_UN)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False
