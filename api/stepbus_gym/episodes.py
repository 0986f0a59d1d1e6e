"""Where the files of an environment's episodes are."""

import itertools
import shutil
import tempfile
from os import PathLike
from pathlib import Path

from stepbus_orchestrator import RecordingFailed

DEFAULT = "episodes"


class Folders:
    """Makes a folder for each episode.

    record: `none`, `all`, or the folder to record to. Recordings are numbered from 1 on in that
    folder, by default `episodes`, whoever else records there; all others are temporary.
    """

    def __init__(self, record: str | PathLike[str]) -> None:
        self.is_recorded = record != "none"
        self._parent = Path(DEFAULT if record == "all" else record).absolute()
        self._temporary: Path | None = None

    def make(self) -> Path:
        """Return a new folder; raises RecordingFailed where none can be made."""
        try:
            if not self.is_recorded:
                self.drop()
                self._temporary = Path(tempfile.mkdtemp(prefix="gym-stepbus-")).resolve()
                return self._temporary / "run"
            self._parent.mkdir(parents=True, exist_ok=True)
            return next(
                path
                for number in itertools.count(self._newest() + 1)
                if _is_made(path := self._parent / f"{number:06}")
            )
        except OSError as exc:
            raise RecordingFailed(
                f"cannot make a folder for an episode: {exc.filename}: {exc.strerror or exc}"
            ) from exc

    def _newest(self) -> int:
        names = (path.name for path in self._parent.iterdir())
        return max((int(name) for name in names if name.isdigit()), default=0)

    def drop(self) -> None:
        """Remove what is temporary."""
        if self._temporary is not None:
            shutil.rmtree(self._temporary, ignore_errors=True)
            self._temporary = None


def _is_made(folder: Path) -> bool:
    try:
        folder.mkdir()
    except FileExistsError:
        return False
    return True
