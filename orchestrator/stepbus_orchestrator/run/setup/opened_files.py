"""Sees which files of a scenario's folder are read during a run, by inotify of Linux.

A run whose programs read what the recording does not hold cannot be repeated from it.
"""

import ctypes
import os
import re
import struct
from collections.abc import Collection, Iterator
from itertools import islice
from pathlib import Path
from typing import Self

_READ = 0x00000010
"""IN_CLOSE_NOWRITE: a file that was opened to be read only is closed again, or its process ends."""

_IS_FOLDER = 0x40000000
_HEAD = struct.Struct("iIII")
_PIECE = 64 * 1024
_MOST_FOLDERS = 500
_SCENARIO = re.compile(rb"^(participants|extends)[ \t]*:", re.MULTILINE)
_SKIPPED = frozenset({"__pycache__", "node_modules", "runs", "site-packages"})


class OpenedFiles:
    """Watches the files that a folder holds at the start of a run, but for hidden ones.

    folder: None: nothing is watched. without: a folder to leave out.
    """

    def __init__(self, folder: Path | None, without: Path) -> None:
        self._folder = folder or Path()
        self._watched: dict[int, Path] = {}
        self._files: set[Path] = set()
        self._descriptor = -1
        if folder is None:
            return
        libc = ctypes.CDLL(None, use_errno=True)
        self._descriptor = int(libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC))
        if self._descriptor < 0:
            return
        for found in _folders(folder, without.resolve()):
            number = int(libc.inotify_add_watch(self._descriptor, os.fsencode(found), _READ))
            if number >= 0:
                self._watched[number] = found
                self._files.update(_files_of(found))

    def __enter__(self) -> Self:
        """Return it."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the watch."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def read_beside(self, known: Collection[str]) -> list[str]:
        """Return the files that were read and are not among those known, sorted.

        known: paths relative to the folder, with `/`.
        """
        names = {path.relative_to(self._folder).as_posix() for path in self._read()}
        return sorted(names - set(known))

    def _read(self) -> Iterator[Path]:
        while self._descriptor >= 0:
            try:
                data = os.read(self._descriptor, _PIECE)
            except BlockingIOError:
                return
            offset = 0
            while offset < len(data):
                number, mask, _, length = _HEAD.unpack_from(data, offset)
                offset += _HEAD.size + length
                name = os.fsdecode(data[offset - length : offset].rstrip(b"\0"))
                path = self._watched.get(number, self._folder) / name
                if name and not mask & _IS_FOLDER and path in self._files:
                    yield path


def _folders(top: Path, without: Path) -> Iterator[Path]:
    for found, folders, _ in islice(os.walk(top), _MOST_FOLDERS):
        folders[:] = sorted(
            name
            for name in folders
            if name not in _SKIPPED
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
    yield from (path for path in found if not (path.name.startswith(".") or _is_scenario(path)))


def _is_scenario(path: Path) -> bool:
    """Return whether a file is a scenario: that of another run in this folder, or a part of one."""
    if path.suffix not in {".yaml", ".yml"}:
        return False
    try:
        return _SCENARIO.search(path.read_bytes()) is not None
    except OSError:
        return False
