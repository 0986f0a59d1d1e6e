"""Sees which files of a scenario's folder a run reads, by fanotify or inotify of Linux.

A run whose programs read what the recording does not hold cannot be repeated from it.
"""

import contextlib
import ctypes
import os
import select
import struct
import threading
from collections.abc import Callable, Collection, Iterator
from itertools import islice
from pathlib import Path
from typing import Self

from stepbus_orchestrator.scenario.files.paths import INSTALLED, is_scenario

_OPENED = 0x00000020
_READ = 0x00000010
"""CLOSE_NOWRITE: a file that was opened to be read only is closed again, or its process ends."""

_IS_FOLDER = 0x40000000
_HEAD = struct.Struct("iIII")
_PIECE = 64 * 1024
_FANOTIFY_HEAD = struct.Struct("IBBHQii")
_FANOTIFY_PIECE = 16 * _FANOTIFY_HEAD.size
"""Each event opens a file."""
_ON_FILES = 0x08000000
_CLOEXEC_NONBLOCK = 0x3
_ADD = 0x1
_HERE = -100
_TICK_S = 0.2
_END_S = 2.0
_MOST_FOLDERS = 500


class OpenedFiles:
    """Watches the files that a folder holds at the start of a run, but for hidden ones.

    folder: None: nothing is watched. without: a folder to leave out. knows_readers: whether the
    system tells us who reads a file, which it does for root; otherwise whoever reads one counts.
    """

    def __init__(self, folder: Path | None, without: Path) -> None:
        self._folder = folder or Path()
        self._watch: _Readers | _Anybody | None = None
        if folder is None:
            return
        folders = list(_folders(folder, without.resolve()))
        files = (path for found in folders for path in _files_of(found))
        self._files = {path.resolve(): path for path in files}
        for make in (_Readers, _Anybody):
            with contextlib.suppress(OSError, RuntimeError):
                self._watch = make(folders)
                return

    @property
    def knows_readers(self) -> bool:
        """Return whether only what the processes of the run read counts."""
        return self._watch is not None and self._watch.knows_readers

    def __enter__(self) -> Self:
        """Return it."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the watch."""
        if self._watch is not None:
            self._watch.close()
            self._watch = None

    def read_beside(self, known: Collection[str], processes: Collection[int]) -> list[str]:
        """Return the files that were read and are not among those known, sorted.

        known: paths relative to the folder, with `/`. processes: of the run: ids of processes,
        groups or sessions.
        """
        if self._watch is None:
            return []
        read = {path.resolve() for path in self._watch.read_by(processes)}
        found = (self._files[path] for path in read & self._files.keys())
        return sorted({path.relative_to(self._folder).as_posix() for path in found} - set(known))


class _Anybody:
    """Sees what is read, not by whom. Raises OSError where that is not allowed."""

    knows_readers = False

    def __init__(self, folders: Collection[Path]) -> None:
        libc = ctypes.CDLL(None, use_errno=True)
        self._descriptor = _checked(libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC))
        self._watched: dict[int, Path] = {}
        for folder in folders:
            number = int(libc.inotify_add_watch(self._descriptor, os.fsencode(folder), _READ))
            if number >= 0:
                self._watched[number] = folder

    def close(self) -> None:
        """End the watch."""
        os.close(self._descriptor)

    def read_by(self, _processes: Collection[int]) -> Iterator[Path]:
        """Yield what was read."""
        while True:
            try:
                data = os.read(self._descriptor, _PIECE)
            except BlockingIOError:
                return
            offset = 0
            while offset < len(data):
                number, mask, _, length = _HEAD.unpack_from(data, offset)
                offset += _HEAD.size + length
                name = os.fsdecode(data[offset - length : offset].rstrip(b"\0"))
                if name and not mask & _IS_FOLDER and number in self._watched:
                    yield self._watched[number] / name


class _Readers:
    """Sees what is read, and by which process.

    Raises OSError where that is not allowed, RuntimeError where no thread can start.
    """

    knows_readers = True

    def __init__(self, folders: Collection[Path]) -> None:
        libc = ctypes.CDLL(None, use_errno=True)
        mark: Callable[..., int] = libc.fanotify_mark
        mark.argtypes = (  # type: ignore[attr-defined]  # ctypes: the mask has 64 bits
            *(ctypes.c_int, ctypes.c_uint, ctypes.c_uint64, ctypes.c_int, ctypes.c_char_p),
        )
        flags = os.O_RDONLY | os.O_CLOEXEC
        self._descriptor = _checked(libc.fanotify_init(_CLOEXEC_NONBLOCK, flags))
        self._ids: dict[int, frozenset[int]] = {}
        self._found: set[tuple[Path, int]] = set()
        self._is_over = threading.Event()
        self._wake = -1
        self._thread = threading.Thread(target=self._work, name="opened files", daemon=True)
        try:
            self._wake = os.eventfd(0)
            for folder in folders:
                mask = _OPENED | _READ | _ON_FILES
                _checked(mark(self._descriptor, _ADD, mask, _HERE, os.fsencode(folder)))
            self._thread.start()
        except BaseException:
            self._close_files()
            raise

    def close(self) -> None:
        """End the watch."""
        self._end_thread()
        if not self._thread.is_alive():
            self._close_files()

    def _end_thread(self) -> None:
        self._is_over.set()
        os.eventfd_write(self._wake, 1)
        self._thread.join(_END_S)

    def _close_files(self) -> None:
        for descriptor in (self._descriptor, self._wake):
            if descriptor >= 0:
                os.close(descriptor)

    def read_by(self, processes: Collection[int]) -> Iterator[Path]:
        """Yield what these processes, groups or sessions have read."""
        self._end_thread()
        with contextlib.suppress(OSError):
            self._take()
        ours = frozenset(processes)
        yield from (path for path, pid in list(self._found) if self._ids[pid] & ours)

    def _work(self) -> None:
        """Take the events as they come: who has ended can no longer be asked who it was."""
        while not self._is_over.is_set():
            select.select([self._descriptor, self._wake], [], [], _TICK_S)
            try:
                self._take()
            except OSError:
                # We may open no more files: later.
                self._is_over.wait(_TICK_S)

    def _take(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while data := os.read(self._descriptor, _FANOTIFY_PIECE):
                for offset in range(0, len(data), _FANOTIFY_HEAD.size):
                    self._add(*_FANOTIFY_HEAD.unpack_from(data, offset)[4:])

    def _add(self, mask: int, file: int, pid: int) -> None:
        if file < 0:
            return
        try:
            ids = self._ids.get(pid, frozenset())
            self._ids[pid] = ids or _ids_of(pid)
            if mask & _READ:
                self._found.add((Path(f"/proc/self/fd/{file}").readlink(), pid))
        finally:
            os.close(file)


def _ids_of(pid: int) -> frozenset[int]:
    """Return a process with its group and session; nothing where it has ended."""
    try:
        return frozenset({pid, os.getpgid(pid), os.getsid(pid)})
    except ProcessLookupError:
        return frozenset()


def _checked(number: int) -> int:
    """Return what a system call gave; raises OSError for an error."""
    if number < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return number


def _folders(top: Path, without: Path) -> Iterator[Path]:
    for found, folders, _ in islice(os.walk(top), _MOST_FOLDERS):
        folders[:] = sorted(
            name
            for name in folders
            if name not in INSTALLED
            and not name.startswith(".")
            and Path(found, name).resolve() != without
        )
        yield Path(found)


def _files_of(folder: Path) -> Iterator[Path]:
    try:
        with os.scandir(folder) as entries:
            found = [Path(entry.path) for entry in entries if entry.is_file()]
    except OSError:
        return
    for path in found:
        # A scenario is that of another run in this folder, or a part of one.
        of_a_run = path.suffix in {".yaml", ".yml"} and is_scenario(path)
        if not (path.name.startswith(".") or of_a_run):
            yield path
