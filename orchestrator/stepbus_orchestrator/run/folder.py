"""The folder of a run: a new one for each, or one that is not kept."""

import contextlib
import os
import shutil
import tempfile
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from itertools import chain, count
from pathlib import Path

from stepbus_orchestrator.errors import OutputExists, RecordingFailed, RunFailure
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_participant import WARNING, make_folder, make_new_folder, read_file

LOGS_FOLDER = "logs"
HEAD_BYTES = 1 << 16


def default_folder(scenario: Scenario, parent: Path) -> Path:
    """Make a new folder for a run: `<scenario>-<time>`, or the first free `<scenario>-<time>-<n>`.

    Two runs that start in the same second get different ones. Raises RecordingFailed when it
    cannot be made.
    """
    stem = f"{scenario.name}-{datetime.now().astimezone():%Y%m%d-%H%M%S}"
    return new_folder(parent, chain([stem], (f"{stem}-{number}" for number in count(2))))


def new_folder(parent: Path, names: Iterable[str]) -> Path:
    """Make the first of these folders that does not exist yet; raises RecordingFailed."""
    try:
        make_folder(parent)
        return first_new(parent / name for name in names)
    except OSError as exc:
        raise RecordingFailed(f"cannot create a folder in {parent}: {exc.strerror}") from exc


def first_new(folders: Iterable[Path]) -> Path:
    """Make the first of these folders that does not exist yet, and return it."""
    return next(folder for folder in folders if _is_made(folder))


def _is_made(folder: Path) -> bool:
    """Make a folder; return False where another process has made it."""
    try:
        make_new_folder(folder)
    except FileExistsError:
        return False
    return True


def warnings_in(log: bytes) -> list[str]:
    """Return the warnings at the beginning of a participant's log, or of what it printed."""
    lines = log[:HEAD_BYTES].decode(errors="replace").splitlines()
    return [line.removeprefix(WARNING) for line in lines if line.startswith(WARNING)]


def claim(out: Path) -> None:
    """Make a run's folder, with one for logs in it; raises OutputExists where one is in use."""
    taken = (layout.RUN_FILE, layout.TIMING_FILE)
    try:
        is_used = any(os.path.lexists(out / name) for name in taken)
        if not is_used:
            make_folder(out)
            # Of two runs that are given the same folder, one makes this.
            is_used = not _is_made(out / LOGS_FOLDER)
    except OSError as exc:
        raise RecordingFailed(f"cannot create folder {out}: {exc.strerror}") from exc
    if is_used:
        raise OutputExists(f"{out} already contains a run; choose another --out")


def read_files(paths: Mapping[str, Path]) -> dict[str, bytes]:
    """Return the content of files, by name; raises RecordingFailed when one cannot be read."""
    contents = {}
    for name, path in paths.items():
        try:
            contents[name] = read_file(path)
        except OSError as exc:
            raise RecordingFailed(f"{path} cannot be read: {exc.strerror}") from exc
    return contents


_LAST_LINES = 20


@contextlib.contextmanager
def scratch_folder(purpose: str) -> Iterator[Path]:
    """Make a folder for temporary files, removed on every path.

    A RunFailure that names a log in it quotes the end of that log instead. Raises RecordingFailed
    where no folder can be made.
    """
    try:
        folder = Path(tempfile.mkdtemp(prefix=f"{purpose}-stepbus-")).resolve()
    except OSError as exc:
        raise RecordingFailed(
            f"cannot create a temporary folder: {exc.strerror or exc}; set TMPDIR to a "
            "writable folder"
        ) from exc
    try:
        yield folder
    except RunFailure as exc:
        exc.args = (_quoting(str(exc), folder),)
        raise
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _quoting(reason: str, folder: Path) -> str:
    """Return a reason with the last lines of each log that it names."""
    quoted = ""
    for log in sorted(folder.rglob("*.log")):
        named = f"its log: {log}"
        if named in reason:
            lines = _last_lines(log)
            # The log of a participant that refuses its parameters has only that sentence, too.
            if lines and all(line.rpartition(": step -1: ")[2] in reason for line in lines):
                reason, lines = reason.replace(f"; {named}", ""), []
            reason = reason.replace(named, "its log ends below" if lines else "its log is empty")
            quoted += "".join(f"\n  {line}" for line in lines)
    return reason + quoted


def _last_lines(log: Path) -> list[str]:
    with contextlib.suppress(OSError), log.open(encoding="utf-8", errors="replace") as file:
        return [line.rstrip() for line in deque(file, _LAST_LINES)]
    return []
