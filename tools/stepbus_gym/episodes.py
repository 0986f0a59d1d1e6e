"""Where the files of an environment's episodes are."""

import itertools
import os
import shutil
import tempfile
import weakref
from collections.abc import Callable
from os import PathLike
from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.run.folder import first_new

DEFAULT = "episodes"


class Folders:
    """Makes a folder for each episode.

    record: `none`, `all`, or the folder to record to. Recordings are numbered from 1 on in that
    folder, by default `episodes`, whatever else records there; all others are temporary.
    """

    def __init__(self, record: str | PathLike[str]) -> None:
        self.is_recorded = record != "none"
        self._parent = Path(DEFAULT if record == "all" else record).absolute()
        self._remove: Callable[[], object] = _nothing

    def make(self) -> Path:
        """Return a new folder; raises RecordingFailed where none can be made."""
        try:
            if not self.is_recorded:
                self.drop()
                folder = Path(tempfile.mkdtemp(prefix="gym-stepbus-")).resolve()
                # Also at the end of a process that has closed nothing.
                self._remove = weakref.finalize(self, _remove, folder, os.getpid())
                return folder / "run"
            self._parent.mkdir(parents=True, exist_ok=True)
            numbers = itertools.count(self._newest() + 1)
            return first_new(self._parent / f"{number:06}" for number in numbers)
        except OSError as exc:
            raise RecordingFailed(
                f"cannot create a folder for an episode: {exc.filename}: {exc.strerror or exc}"
            ) from exc

    def _newest(self) -> int:
        names = (path.name for path in self._parent.iterdir())
        return max((int(name) for name in names if name.isdigit()), default=0)

    def drop(self) -> None:
        """Remove what is temporary."""
        self._remove()


def _nothing() -> None:
    """Remove nothing."""


def _remove(folder: Path, pid: int) -> None:
    """Remove a folder, but not from a process that was forked."""
    if os.getpid() == pid:
        shutil.rmtree(folder, ignore_errors=True)
