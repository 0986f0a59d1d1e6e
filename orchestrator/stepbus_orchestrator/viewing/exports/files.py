"""Files of an export: nobody sees half of one."""

import contextlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed


@dataclass(frozen=True, kw_only=True)
class Exported:
    """What an export wrote. problems: a sentence for all that it could not."""

    paths: Sequence[Path]
    problems: Sequence[str] = ()


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
    except OSError as exc:
        raise RecordingFailed(f"{target} cannot be written: {exc.strerror or exc}") from exc
    finally:
        with contextlib.suppress(OSError):
            part.unlink()
