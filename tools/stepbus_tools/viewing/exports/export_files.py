"""The files that an export writes, and how far it is."""

import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Port, Recording
from stepbus_schemas import ENVELOPE_TYPES, StepbusError

Reached = Callable[[int], None]
"""Takes the step that was reached."""


@contextmanager
def progress_bar(what: str, last_step: int) -> Iterator[Reached]:
    """Show how far an export has come, where the standard error is a terminal."""
    if not sys.stderr.isatty():
        yield lambda _step: None
        return
    # It takes a tenth of a second to load.
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import (  # noqa: PLC0415
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn())
    console = Console(stderr=True)
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as bar:
        task = bar.add_task(what, total=max(1, last_step))
        yield lambda step: bar.update(task, completed=step)


@dataclass(frozen=True, kw_only=True)
class Exported:
    """What an export wrote.

    problems: a sentence for all that it could not. lost: topics of ports that it lacks, or ends
    before their last message, though the form could have had them.
    """

    paths: Sequence[Path]
    problems: Sequence[str] = ()
    lost: Collection[str] = ()


def check_readable(recording: Recording) -> None:
    """Raise RecordingFailed when nothing of a recording can be shown: it is of something else."""
    if not any(p.type in recording.types and p.last_step >= 0 for p in recording.ports.values()):
        raise nothing_to_export(recording, "shown")


def nothing_to_export(recording: Recording, done: str = "exported") -> RecordingFailed:
    """Return why nothing of a recording can be exported: it is empty, damaged or foreign."""
    unknown = sorted({p.type for p in recording.ports.values() if p.type not in recording.types})
    unknown = [name for name in unknown if name not in ENVELOPE_TYPES]
    why = f"it {recording.cut_short}" if recording.cut_short else ""
    if unknown:
        why = f"it is not of stepbus, or of a newer one: its types are {', '.join(unknown)}"
    reason = f": {why}" if why else ""
    return RecordingFailed(f"{recording.path} has no message that can be {done}{reason}")


def unreadable(port: Port, exc: StepbusError) -> str:
    """Return why a port is not shown, without the list of all types that are known."""
    return f"{port.topic}: {str(exc).partition('; known:')[0]}"
