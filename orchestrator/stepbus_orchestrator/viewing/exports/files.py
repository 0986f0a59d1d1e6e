"""Files of an export: nobody sees half of one."""

import contextlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Port, Recording
from stepbus_schemas import ENVELOPE_TYPES, StepbusError


@dataclass(frozen=True, kw_only=True)
class Exported:
    """What an export wrote. problems: a sentence for all that it could not."""

    paths: Sequence[Path]
    problems: Sequence[str] = ()


def check_readable(recording: Recording) -> None:
    """Raise RecordingFailed when nothing of a recording can be shown: it is of something else."""
    if not any(p.type in recording.types and p.last_step >= 0 for p in recording.ports.values()):
        raise nothing_to_export(recording, "shown")


def nothing_to_export(recording: Recording, done: str = "exported") -> RecordingFailed:
    """Return why nothing of a recording can be exported: it is empty, damaged or foreign."""
    unknown = sorted({p.type for p in recording.ports.values() if p.type not in recording.types})
    unknown = [name for name in unknown if name not in ENVELOPE_TYPES]
    why = recording.damage
    if unknown:
        why = f"it is not of stepbus, or of a newer one: its types are {', '.join(unknown)}"
    reason = f": {why}" if why else ""
    return RecordingFailed(f"{recording.path} has no message that can be {done}{reason}")


def unreadable(port: Port, exc: StepbusError) -> str:
    """Return why a port is not shown, without the list of all types that are known."""
    return f"{port.topic}: {str(exc).partition('; known:')[0]}"


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
