"""Bulk content in files that the participants of a run share, instead of in messages (P17).

The limit of the steps says when a slot is free: the orchestrator has made a ring so long that
whoever may publish step k knows that all have taken what its slot held. So nothing is counted, and
nothing can be lost. Participants map the files: a call looks up each page of them, which takes
longer than to copy it. No view outlives its step: what is decoded is a copy. The orchestrator reads
by calls: it has to survive whoever cuts a file, and a mapped one is a SIGBUS then.
"""

import contextlib
import mmap
import os
import struct
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TypeVar

from stepbus_schemas import RunError, Welcome

from . import BusError

_HEADER = struct.Struct("<qq")
"""Step and length of the content after it."""
_PAGE = 4096
_T = TypeVar("_T")


class SlotError(RunError):
    """A slot does not hold what was announced."""


def file_name(participant: str, port: str) -> str:
    """Return the name of the file for a bulk output, `<participant>.<port>`."""
    return f"{participant}.{port}"


def read_slot(fd: int, offset: int, step: int, length: int) -> bytes:
    """Return the content of a slot; raises SlotError where it is not that of this step.

    Its header is read before and after the content: it would differ, had the slot been reused.
    """
    try:
        stamp = _HEADER.pack(step, length)
        if os.pread(fd, _HEADER.size, offset) == stamp:
            content = os.pread(fd, length, offset + _HEADER.size)
            if os.pread(fd, _HEADER.size, offset) == stamp and len(content) == length:
                return content
    except (OSError, OverflowError, MemoryError, struct.error) as exc:
        raise SlotError(f"its slot of {length} bytes cannot be read: {exc}") from exc
    raise _differs(step, length)


def _differs(step: int, length: int) -> SlotError:
    return SlotError(
        f"its slot does not hold the {length} bytes of step {step}; was the file modified?"
    )


class _ReadFile:
    """A file of slots to read, mapped as far as it has been needed."""

    def __init__(self, fd: int) -> None:
        self.fd = fd
        self._view = memoryview(b"")

    def slot(self, offset: int, size: int) -> memoryview:
        """Return a part of its content, which is shorter where the file is.

        Asked each time, so that a file that was cut since is an error rather than a SIGBUS. Raises
        OSError.
        """
        end = min(offset + size, os.fstat(self.fd).st_size)
        if end > len(self._view):
            self._view = memoryview(mmap.mmap(self.fd, 0, prot=mmap.PROT_READ))
        return self._view[offset:end]


class SlotContent:
    """Content in its slot, until it is decoded."""

    def __init__(self, file: _ReadFile, offset: int, step: int, length: int) -> None:
        self._file = file
        self._where = (offset, step, length)

    def __bytes__(self) -> bytes:
        return self.decoded(bytes)

    def decoded(self, decode: Callable[[bytes | memoryview], _T]) -> _T:
        """Return what `decode` makes of it, which must keep no view of it.

        Raises SlotError where the slot does not hold it, and what `decode` raises.
        """
        offset, step, length = self._where
        try:
            stamp = _HEADER.pack(step, length)
            slot = self._file.slot(offset, _HEADER.size + length)
        except (OSError, struct.error) as exc:
            raise SlotError(f"its slot of {length} bytes cannot be read: {exc}") from exc
        header = slot[: _HEADER.size]
        try:
            if header == stamp and len(slot) == _HEADER.size + length:
                return decode(slot[_HEADER.size :])
        finally:
            if header != stamp:
                raise _differs(step, length)
        raise _differs(step, length)


class SlotWriter:
    """Writes the content of one bulk output into its slots, one after the other.

    fd: of its file. count: how many slots it has.
    """

    def __init__(self, fd: int, count: int, path: Path) -> None:
        self._fd = fd
        self._count = count
        self._path = path
        self._file: mmap.mmap
        self._base = self._end = self._stride = self._next = 0

    def write(self, step: int, content: bytes) -> int:
        """Write the content of a step; return the offset of its slot in the file [bytes].

        Raises BusError where there is no room for the slots, or no longer.
        """
        size = _HEADER.size + len(content)
        try:
            if size > self._stride:
                self._grow(size)
        except OSError as exc:
            number = "a slot" if self._count == 1 else f"{self._count} slots"
            raise BusError(
                f"cannot reserve {number} of {size * 1e-6:.3g} MB in {self._path}: "
                f"{exc.strerror}; free disk space there, or lower `window`"
            ) from exc
        if (found := os.fstat(self._fd).st_size) < self._end:
            # A write past its end would be a SIGBUS.
            raise BusError(
                f"another process truncated {self._path} from {self._end} to {found} bytes"
            )
        offset = self._base + self._next * self._stride
        self._next = (self._next + 1) % self._count
        at = offset + _HEADER.size
        # The header first: whoever still read the slot would find that it has changed.
        self._file[offset:at] = _HEADER.pack(step, len(content))
        self._file[at : at + len(content)] = content
        return offset

    def _grow(self, size: int) -> None:
        """Set aside slots that hold content of this size; those before stay until they are read."""
        # A number in the next message may take some bytes more.
        stride = -(-max(size + _PAGE // 2, 2 * self._stride) // _PAGE) * _PAGE
        end = self._end + self._count * stride
        # All at once: a write into what is set aside finds its room.
        os.posix_fallocate(self._fd, self._end, end - self._end)
        self._file = mmap.mmap(self._fd, end)
        self._base, self._stride, self._end = self._end, stride, end


class Slots:
    """The files of slots that a participant has opened: of its bulk outputs and inputs.

    folder: of the ticket; empty: none. It opens what it can; who cannot, gets and sends its content
    in messages.
    """

    def __init__(self, folder: str, welcome: Welcome) -> None:
        self._files: dict[str, _ReadFile] = {}
        self._name = welcome.name
        self._folder = Path(folder)
        if folder:
            own = (port for port, output in welcome.outputs.items() if output.bulk)
            self._open((file_name(self._name, port) for port in own), os.O_RDWR)
            read = (item for item in welcome.inputs.values() if item.bulk)
            self._open((file_name(item.source, item.port) for item in read), os.O_RDONLY)

    def _open(self, names: Iterable[str], mode: int) -> None:
        for name in names:
            if name not in self._files:
                with contextlib.suppress(OSError):
                    flags = mode | os.O_CLOEXEC | os.O_NOFOLLOW
                    self._files[name] = _ReadFile(os.open(self._folder / name, flags))

    @property
    def names(self) -> list[str]:
        """Return the outputs whose slots this participant can use, `<participant>.<port>`."""
        return list(self._files)

    def writers(self, counts: Mapping[str, int]) -> dict[str, SlotWriter]:
        """Return port → writer of each bulk output of its own; counts: as of `Start.slots`."""
        own = file_name(self._name, "")
        return {
            name.removeprefix(own): SlotWriter(self._files[name].fd, count, self._folder / name)
            for name, count in counts.items()
            if name.startswith(own)
        }

    def content(
        self, source: str, port: str, *, offset: int, step: int, length: int
    ) -> SlotContent:
        """Return what a source has written; raises SlotError where it may not be in a slot."""
        file = self._files.get(file_name(source, port))
        if file is None:
            raise SlotError("it refers to a slot, but no slots were negotiated")
        return SlotContent(file, offset, step, length)

    def close(self) -> None:
        """Close the files; harmless when repeated."""
        while self._files:
            os.close(self._files.popitem()[1].fd)
