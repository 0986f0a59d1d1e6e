"""Files that are whole, or not there: nobody sees half of one."""

import contextlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed


@contextmanager
def replaced(target: Path) -> Iterator[Path]:
    """Yield a file beside `target` to write, which takes its name at the end.

    Raises RecordingFailed when it cannot be written; then it is gone.
    """
    part = target.with_name(f".{target.name}.part")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield part
        part.replace(target)
    except RecordingFailed:
        raise
    except OSError as exc:
        raise RecordingFailed(f"{target} cannot be written: {exc.strerror or exc}") from exc
    finally:
        with contextlib.suppress(OSError):
            part.unlink()
