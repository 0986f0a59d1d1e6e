"""A file that a full disk cannot corrupt, and that others can see is being written."""

import contextlib
import fcntl
import hashlib
import os
import struct
from pathlib import Path

from stepbus_participant import Disk, make_file, open_regular, write_at

_RESERVE_BYTES = 512 * 1024
_END_BYTES = 256 * 1024
"""For the end of a file beside the index of its chunks: channels, schemas, statistics."""
_MORE_BYTES = 256 * 1024
_HEAD = struct.Struct("<BQ")
_PRIVATE_OPCODE = 0x80
"""A record of this type is skipped by every reader of MCAP."""


class ReservedFile:
    """An append-only file of complete writes: one that fails leaves nothing behind.

    A reserve of 512 KiB, or more where `keep_room` asks for it, is given back by `release`: room to
    close the file properly, so that a recording on a full disk ends with its index. It is a
    file without a name, so that it goes with the process, however that ends. Until it is closed, it
    is locked as one that is being written.

    sha256: of all that has been written. disk: of the run.
    """

    def __init__(self, path: Path, disk: Disk = os) -> None:
        self._path = path
        self._disk = disk
        self._position = 0
        self._ahead = 0
        self.sha256 = hashlib.sha256()
        self.closed = False
        self._reserve = -1
        self._reserved = 0
        # A named pipe that stands there would wait for a reader without O_NONBLOCK.
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOFOLLOW
        self._file = disk.open(path, flags, 0o644)
        status = os.fstat(self._file)
        self._identity = self._identity_of(status)
        lock(self._file)
        try:
            self._make_reserve()
        except OSError:
            self._disk.close(self._file)
            self.release()
            raise

    def _make_reserve(self) -> None:
        name = self._path.with_name(f".{self._path.name}.reserve")
        self._reserve = make_file(name, 0o600, self._disk)
        self._disk.unlink(name)
        self._set_aside(_RESERVE_BYTES)

    def _set_aside(self, size: int) -> None:
        self._disk.posix_fallocate(self._reserve, self._reserved, size - self._reserved)
        self._reserved = size

    def keep_room(self, size: int) -> None:
        """Keep room for an index of so many bytes; raises OSError when there is none."""
        needed = _END_BYTES + size
        if needed > self._reserved and self._reserve >= 0:
            self._set_aside(needed + _MORE_BYTES)

    def tell(self) -> int:
        """Return how much has been written [bytes]."""
        return self._position

    def write(self, data: bytes) -> int:
        """Append all of `data`, or nothing of it.

        Raises OSError, e.g. when the disk is full, and ValueError when the file is closed: its
        descriptor may belong to another file by then.
        """
        if self.closed:
            raise ValueError(f"{self._path} is closed")
        over = self._ahead - len(data)
        # Who is killed here leaves no rubbish behind `data`, but one record that nobody reads.
        cover = _HEAD.pack(_PRIVATE_OPCODE, max(0, over - _HEAD.size)) if over > 0 else b""
        try:
            write_at(self._disk, self._file, data + cover if cover else data, self._position)
            if cover:
                self._disk.ftruncate(self._file, self._position + len(data))
        except OSError:
            self._disk.ftruncate(self._file, self._position)
            raise
        finally:
            self._ahead = 0
        self._position += len(data)
        self.sha256.update(data)
        return len(data)

    def write_ahead(self, data: bytes) -> bool:
        """Append bytes that the next `write` replaces; returns whether there was room for them."""
        end = self._position + self._ahead
        try:
            write_at(self._disk, self._file, data, end)
        except OSError:
            with contextlib.suppress(OSError):
                self._disk.ftruncate(self._file, end)
            return False
        self._ahead += len(data)
        return True

    def flush(self) -> None:
        """Nothing is held back."""

    @staticmethod
    def _identity_of(status: os.stat_result) -> tuple[int, int]:
        return status.st_dev, status.st_ino

    def changed(self) -> str:
        """Return what somebody else did to the file; empty when it holds all that was written.

        It reads the whole file. Raises OSError when it cannot be read.
        """
        try:
            # Before it is opened: whoever opens a pipe waits for its other end.
            if self._identity_of(self._path.stat()) != self._identity:
                return "was replaced by another file"
            with self._path.open("rb") as file:
                status = os.fstat(file.fileno())
                if status.st_size != self._position:
                    return f"has {status.st_size} bytes, not the {self._position} that were written"
                digest = hashlib.file_digest(file, "sha256")
        except (FileNotFoundError, NotADirectoryError):
            return "was removed"
        same = digest.digest() == self.sha256.digest()
        return "" if same else "has another content than was written"

    def release(self) -> None:
        """Give back the room that was set aside."""
        if self._reserve >= 0:
            self._disk.close(self._reserve)
            self._reserve = -1

    def close(self) -> None:
        """Close the file; harmless when repeated."""
        if not self.closed:
            self.closed = True
            unlock(self._file)
            with contextlib.suppress(OSError):
                self._disk.close(self._file)
            self.release()


_LOCK = struct.Struct("hhqqi0q")
"""`struct flock`: type, whence, start, length, process. A lock of an open file (OFD): unlike one of
a process, it does not end when that process opens and closes the same file once more."""


def lock(file: int) -> None:
    """Let others see that a file is being written; where its file system has no locks, nobody."""
    _set(file, fcntl.F_WRLCK)


def unlock(file: int) -> None:
    """Let others see that a file is complete; children that have inherited it do not matter."""
    _set(file, fcntl.F_UNLCK)


def _set(file: int, kind: int) -> None:
    with contextlib.suppress(OSError):
        fcntl.fcntl(file, fcntl.F_OFD_SETLK, _LOCK.pack(kind, os.SEEK_SET, 0, 0, 0))


def is_being_written(path: Path) -> bool:
    """Return whether a recording is being written; not of a file that cannot be read."""
    try:
        file = open_regular(path)
    except OSError:
        return False
    try:
        return is_locked(file)
    finally:
        os.close(file)


def is_locked(file: int) -> bool:
    """Return whether somebody else is writing a file."""
    try:
        question = _LOCK.pack(fcntl.F_RDLCK, os.SEEK_SET, 0, 0, 0)
        answer = fcntl.fcntl(file, fcntl.F_OFD_GETLK, question)
    except OSError:
        return False
    kind: int = _LOCK.unpack(answer)[0]
    return kind != fcntl.F_UNLCK
