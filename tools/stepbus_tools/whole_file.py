"""Files of tools that are whole, or not there: no reader sees half of one."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_participant import irregular
from stepbus_participant import replaced as part_of


@contextmanager
def replaced(target: Path) -> Iterator[Path]:
    """Yield an empty file beside `target` to write, which takes its name at the end.

    Raises RecordingFailed when it cannot be written, where it is gone then, and before that where
    `target` is there and no regular file: a device, a pipe, a folder or a link.
    """
    if irregular(target):
        raise RecordingFailed(f"{target} is not a regular file; choose another name")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with part_of(target) as part:
            yield part
    except RecordingFailed:
        raise
    except OSError as exc:
        raise RecordingFailed(f"{target} cannot be written: {exc.strerror or exc}") from exc
