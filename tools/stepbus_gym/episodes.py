"""Where the files of an environment's episodes are."""

import itertools
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.run.folder import first_new

DEFAULT = "episodes"


class Folders:
    """Makes a folder for each episode.

    record: `none`, `all`, or the folder to record to. Recordings are numbered from 1 on in that
    folder, by default `episodes`, whatever else records there; all others are temporary.
    """

    _temporary: TemporaryDirectory[str] | None = None

    def __init__(self, record: str | PathLike[str]) -> None:
        self.is_recorded = record != "none"
        self._parent = Path(DEFAULT if record == "all" else record).absolute()

    def make(self) -> Path:
        """Return a new folder; raises RecordingFailed where none can be made."""
        try:
            if not self.is_recorded:
                self.drop()
                self._temporary = TemporaryDirectory(
                    prefix="gym-stepbus-", ignore_cleanup_errors=True
                )
                return Path(self._temporary.name).resolve() / "run"
            self._parent.mkdir(parents=True, exist_ok=True)
            known = [int(path.name) for path in self._parent.iterdir() if path.name.isdigit()]
            numbers = itertools.count(max(known, default=0) + 1)
            return first_new(self._parent / f"{number:06}" for number in numbers)
        except OSError as exc:
            raise RecordingFailed(
                f"cannot create a folder for an episode: {exc.filename}: {exc.strerror or exc}"
            ) from exc

    def drop(self) -> None:
        """Remove what is temporary."""
        if self._temporary is not None:
            self._temporary.cleanup()
