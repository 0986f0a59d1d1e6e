"""The programs that this user has started on this machine, by the fingerprints of their scenarios.

A recording holds programs: what a scenario starts, and its files. Those that you have run here may
be started again unasked, wherever their recording lies now; for those of others you are asked. The
list is in `$XDG_STATE_HOME/stepbus/programs` (`~/.local/state/…`). It changes no result.
"""

import contextlib
import hashlib
import os
import stat
from collections.abc import Mapping
from pathlib import Path

from stepbus_participant import open_regular

_LARGEST = 4 * 1024 * 1024
_OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH


def fingerprint(scenario: bytes, files: Mapping[str, bytes]) -> str:
    """Return the SHA-256 of all that a recording can start: its scenario, and files by name."""
    digest = hashlib.sha256()
    for name, content in [("", scenario), *sorted(files.items())]:
        for part in (name.encode(errors="surrogateescape"), content):
            digest.update(len(part).to_bytes(8, "little"))
            digest.update(part)
    return digest.hexdigest()


def folder_mark(folder: Path) -> str:
    """Return what is remembered of a folder whose scenario you have run."""
    return hashlib.sha256(b"folder\0" + os.fsencode(os.path.realpath(folder))).hexdigest()


def is_known_folder(folder: Path) -> bool:
    """Return whether you have run a scenario of this folder on this machine."""
    return is_known(folder_mark(folder))


def remember(programs: str) -> None:
    """Add a fingerprint to the list; does nothing where that cannot be written."""
    with contextlib.suppress(OSError, RuntimeError):
        if is_known(programs):
            return
        path = _path()
        path.parent.mkdir(parents=True, mode=0o700, exist_ok=True)
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
        # A named pipe that stands there is no list, and would wait for a reader.
        flags |= os.O_NONBLOCK
        file = os.open(path, flags, 0o600)
        try:
            if not _is_ours(file):
                return
            os.write(file, f"{programs}\n".encode())
            size = os.fstat(file).st_size
        finally:
            os.close(file)
        if size > _LARGEST:
            _forget_oldest(path)


def is_known(programs: str) -> bool:
    """Return whether a fingerprint is on the list, and nobody else can have written it there."""
    try:
        file = open_regular(_path(), os.O_NOFOLLOW)
    except (OSError, RuntimeError):
        return False
    try:
        return _is_ours(file) and programs.encode() in _read(file).split(b"\n")
    finally:
        os.close(file)


def _path() -> Path:
    given = Path(os.environ.get("XDG_STATE_HOME", ""))
    base = given if given.is_absolute() else Path.home() / ".local" / "state"
    return base / "stepbus" / "programs"


def _is_ours(file: int) -> bool:
    found = os.fstat(file)
    is_own = found.st_uid == os.geteuid() and stat.S_ISREG(found.st_mode)
    return is_own and not found.st_mode & _OTHERS_MAY_WRITE


def _read(file: int) -> bytes:
    with os.fdopen(os.dup(file), "rb") as stream:
        # It is halved where it grows larger; what is much larger is no list.
        return stream.read(2 * _LARGEST)


def _forget_oldest(path: Path) -> None:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 2 * _LARGEST))
        lines = file.read().splitlines(keepends=True)
    part = path.with_name(f".{path.name}.{os.getpid()}")
    part.touch(mode=0o600)
    part.write_bytes(b"".join(lines[len(lines) // 2 :]))
    part.replace(path)
