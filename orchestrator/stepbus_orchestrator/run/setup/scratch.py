"""A folder for a run whose recording nobody keeps, such as that of `describe`."""

import contextlib
import shutil
import tempfile
from collections import deque
from collections.abc import Iterator
from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed, RunFailure

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
            f"cannot make a folder for temporary files: {exc.strerror or exc}; set TMPDIR to one "
            "that can be written"
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
            reason = reason.replace(named, "its log ends below" if lines else "its log is empty")
            quoted += "".join(f"\n  {line}" for line in lines)
    return reason + quoted


def _last_lines(log: Path) -> list[str]:
    with contextlib.suppress(OSError), log.open(encoding="utf-8", errors="replace") as file:
        return [line.rstrip() for line in deque(file, _LAST_LINES)]
    return []
