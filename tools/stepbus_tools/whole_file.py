"""Files that are whole, or not there: no reader sees half of one."""

import contextlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_participant import irregular, make_file


@contextmanager
def replaced(target: Path) -> Iterator[Path]:
    """Yield an empty file beside `target` to write, which takes its name at the end.

    Raises RecordingFailed when it cannot be written, where it is gone then, and before that where
    `target` is there and no regular file: a device, a pipe, a folder or a link.
    """
    part = target.with_name(f".{target.name}.part")
    if irregular(target):
        raise RecordingFailed(f"{target} is not a regular file; choose another name")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        os.close(make_file(part))
        yield part
        part.replace(target)
    except RecordingFailed:
        raise
    except OSError as exc:
        raise RecordingFailed(f"{target} cannot be written: {exc.strerror or exc}") from exc
    finally:
        with contextlib.suppress(OSError):
            part.unlink()
