"""Writes a recording in the forms that it is exported to: `stepbus export`."""

import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress as Bar

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Port, Recording
from stepbus_orchestrator.recording.source import watchers
from stepbus_participant import suggest
from stepbus_schemas import ENVELOPE_TYPES, Message, StepbusError, WiringError
from stepbus_tools.columns import readable
from stepbus_tools.exporters import exporters

Reached = Callable[[int], None]
"""Takes the step that was reached."""
Progress = Callable[[str, int], AbstractContextManager[Reached]]
"""Shows how far an export has come. It takes its form, and the last step."""


@dataclass(frozen=True, kw_only=True)
class Exported:
    """Result of an export.

    problems: a text for each thing that could not be exported. lost: topics that the format
    supports but that are missing or incomplete.
    """

    paths: Sequence[Path]
    problems: Sequence[str] = ()
    lost: Collection[str] = ()


def export(
    recording: Recording,
    targets: Mapping[str, Path],
    *,
    progress: Progress = lambda _form, _last_step: nullcontext(lambda _step: None),
    **options: Any,
) -> Iterator[tuple[str, Exported]]:
    """Write a recording in several forms; yield each form with its result.

    targets: form, such as `parquet`, → path. options: of the exporters. Raises RecordingFailed when
    there is nothing to export or a file cannot be written, WiringError for a form that no package
    has or an option that does not fit, ExtraMissing without the library of a form.
    """
    known = exporters()
    for form, target in targets.items():
        if form not in known:
            raise WiringError(f"no exporter {form!r}{suggest(form, known)}")
        own = {name: options[name] for name in known[form].options if name in options}
        with progress(form, recording.last_step) as reached:
            write = known[form].load()
            done = write(recording, target, reached, **own)
        yield form, done


def damage_line(recording: Recording) -> str:
    """Return why an export ends before its run, as a sentence; empty for a whole recording."""
    if not recording.cut_short:
        return ""
    return f"{recording.path} {recording.cut_short}; exported up to step {recording.last_step}"


def check_readable(recording: Recording) -> None:
    """Raise RecordingFailed for a recording without a readable message."""
    if not any(p.type in recording.types and p.last_step >= 0 for p in recording.ports.values()):
        raise nothing_to_export(recording, "shown")


def nothing_to_export(recording: Recording, done: str = "exported") -> RecordingFailed:
    """Return the error for a recording without a readable message: empty, damaged or foreign."""
    unknown = sorted({p.type for p in recording.ports.values() if p.type not in recording.types})
    unknown = [name for name in unknown if name not in ENVELOPE_TYPES]
    why = f": it {recording.cut_short}" if recording.cut_short else ""
    if unknown:
        why = (
            f": it is not from stepbus, or from a newer version: its types are {', '.join(unknown)}"
        )
    return RecordingFailed(f"{recording.path} has no message that can be {done}{why}")


@contextmanager
def progress_bar(what: str, last_step: int) -> Iterator[Reached]:
    """Show how far an export has come, where the standard error is a terminal."""
    if not sys.stderr.isatty():
        yield lambda _step: None
        return
    watchers.clear()
    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=max(1, last_step))
        yield lambda step: bar.update(task, completed=step)


NS = 1_000_000_000


@dataclass(frozen=True, kw_only=True)
class Instant:
    """One message. step, t_ns: when it was published; t_ns [ns]."""

    step: int
    t_ns: int
    port: Port
    message: Message


def readable_ports(recording: Recording) -> tuple[list[Port], dict[str, str]]:
    """Return the ports with messages of a known type; and topic → why another is lost.

    Raises RecordingFailed without any.
    """
    tables, lost = readable(recording)
    if not tables:
        raise nothing_to_export(recording)
    return [table.port for table in tables], lost


def instants(
    recording: Recording, ports: Collection[Port], lost: dict[str, str], reached: Reached
) -> Iterator[tuple[int, list[Instant]]]:
    """Yield each time [ns] and the messages of some ports at it, in memory that does not grow.

    lost: topic → why it is; gets a port that cannot be read to its end.
    """
    in_order = _in_order(recording, ports, lost, reached)
    for t_ns, group in groupby(in_order, key=lambda instant: instant.t_ns):
        yield t_ns, list(group)


def _in_order(
    recording: Recording, ports: Collection[Port], lost: dict[str, str], reached: Reached
) -> Iterator[Instant]:
    for piece in recording.batches(ports):
        rows = list[Instant]()
        for port in ports:
            batch = piece[port.topic]
            if port.topic in lost:
                continue
            try:
                clock = zip(batch.steps.tolist(), batch.t_ns.tolist(), strict=True)
                for (step, t_ns), message in zip(clock, batch.messages(), strict=True):
                    rows.append(Instant(step=step, t_ns=t_ns, port=port, message=message))
            except StepbusError as exc:
                lost[port.topic] = f"{port.topic}: {exc}"
        # At one time, they are in the order of the ports.
        yield from sorted(rows, key=lambda instant: instant.t_ns)
        if rows:
            reached(rows[-1].step)


class Rate:
    """Lets at most so many messages of each topic pass; all with `math.inf`."""

    def __init__(self, per_s: float) -> None:
        self._period_ns = max(1, round(NS / per_s))
        self._due: dict[str, int] = {}

    def passes(self, topic: str, t_ns: int) -> bool:
        """Return whether a message at a time is due."""
        if t_ns < self._due.get(topic, 0):
            return False
        # On a grid: a message that is a little late does not delay the ones after it.
        self._due[topic] = (t_ns // self._period_ns + 1) * self._period_ns
        return True
