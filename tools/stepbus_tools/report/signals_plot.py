"""Plots any signals of a recording: one panel each, in one picture."""

import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from stepbus_orchestrator.analysis.signals import Array
from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Port, Recording
from stepbus_schemas import WiringError
from stepbus_tools.report.curves import Curve, Line, legend, line
from stepbus_tools.whole_file import replaced

_SIGNAL = re.compile(r"([\w-]+)[./]([\w-]+)(?:\.(\w+))?(?:\[([^\[\]]+)\])?")
MOST_LINES = 20


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One panel. title: of it. unit: of its values; may be empty. lines, dashed: by label."""

    title: str
    unit: str
    lines: dict[str, Line] = field(default_factory=dict)
    dashed: dict[str, Line] = field(default_factory=dict)


def signal_names(recording: Recording) -> list[str]:
    """Return every signal of a recording that can be plotted, as `participant.port.field`."""
    return [
        f"{port.topic.replace('/', '.', 1)}.{field}"
        for port in recording.ports.values()
        if not port.topic.startswith("stepbus/")
        for field in _numeric_fields(port)
    ]


def find_signals(recording: Recording, text: str) -> list[Panel]:
    """Return what a text names: `participant.port`, `….field`, `….field[0]` or `….field[joint1]`.

    Raises WiringError where the recording has no such numbers.
    """
    form = _SIGNAL.fullmatch(text)
    if form is None:
        raise WiringError(f"{text!r} is no signal; write e.g. plant.joint_state.position[0]")
    participant, name, field, index = form.groups()
    port = recording[f"{participant}/{name}"]
    known = list(_numeric_fields(port))
    if field is not None and field not in known:
        others = f"; it has {', '.join(known) or 'none'}"
        raise WiringError(f"{text}: {port.type} has no numbers {field!r} here{others}")
    fields = [field] if field else known
    if not fields:
        raise WiringError(f"{text}: {port.type} carries no numbers to plot")
    return [_signal(port, name, index, text) for name in fields]


def draw_signals(
    title: str, panels: Sequence[Panel], target: Path | BinaryIO, *, mark_s: float | None = None
) -> None:
    """Write the picture, to a stream as PNG. mark_s: a time that is marked [s].

    Raises ImportError without matplotlib, RecordingFailed when it cannot be written.
    """
    figure, axes = _panels(title, len(panels))
    for axis, panel in zip(axes, panels, strict=True):
        _draw(axis, panel)
        if mark_s is not None:
            axis.axvline(mark_s, color="grey", linewidth=1)
    _save(figure, target)


def _panels(title: str, count: int) -> tuple[Any, Any]:
    # Loading matplotlib takes longer than all else here, and it is an extra.
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(14, 1 + 3 * count), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    axes = figure.subplots(count, 1, sharex=True, squeeze=False).flatten()
    axes[-1].set_xlabel("time [s]")
    return figure, axes


def _save(figure: Any, target: Path | BinaryIO) -> None:
    if not isinstance(target, Path):
        figure.savefig(target)
        return
    try:
        picture = drawn(figure, target.suffix[1:] or "png")
    except ValueError as exc:
        raise RecordingFailed(f"{target} cannot be written: {exc}") from exc
    with replaced(target) as part:
        part.write_bytes(picture)


def drawn(figure: Any, form: str) -> bytes:
    """Return a figure as a file of a format, such as `png`; raises ValueError for another."""
    stream = io.BytesIO()
    figure.savefig(stream, format=form)
    return stream.getvalue()


def _draw(axis: Any, panel: Panel) -> None:
    axis.set_title(panel.title, loc="left", fontsize=10)
    axis.set_ylabel(f"[{panel.unit}]" if panel.unit else "")
    axis.grid(visible=True, alpha=0.3)
    axis.margins(x=0.01)
    for rows, is_dashed in ((panel.lines, False), (panel.dashed, True)):
        for number, (label, (t, values)) in enumerate(rows.items()):
            curve = Curve()
            curve.add(t, values[:, None])
            line(axis, curve.line(0), label, number, dashed=is_dashed)
    labels = [*panel.lines, *panel.dashed]
    if labels != [panel.title.rpartition(": ")[2]]:
        legend(axis)


def _signal(port: Port, field: str, index: str | None, text: str) -> Panel:
    values = port[field].astype(float)
    columns = {"": values} if values.ndim == 1 else _columns(port, values)
    if index is not None:
        columns = _chosen(columns, index, text)
    elif len(columns) > MOST_LINES:
        columns = dict(list(columns.items())[:MOST_LINES])
    title = f"{port.topic.replace('/', '.', 1)}.{field}"
    lines = {label or title: (port.t, row) for label, row in columns.items()}
    return Panel(title=title, unit=port.units.get(field, ""), lines=lines)


def _columns(port: Port, values: Array) -> dict[str, Array]:
    width = values.shape[1]
    names = list(port.names) if len(port.names) == width else [f"[{i}]" for i in range(width)]
    return {name: values[:, i] for i, name in enumerate(names)}


def _chosen(columns: dict[str, Array], index: str, text: str) -> dict[str, Array]:
    names = list(columns)
    name = names[int(index)] if index.isdecimal() and int(index) < len(names) else index
    if name not in columns or name == "":
        known = ", ".join(f"[{name.strip('[]')}]" for name in names)
        raise WiringError(f"{text}: there is no [{index}]; it has {known or 'a single number'}")
    return {name: columns[name]}


def _numeric_fields(port: Port) -> Iterator[str]:
    """Yield the fields whose values over time are an array of numbers, in order."""
    for name in port.message_class.__struct_fields__:
        values = port.arrays(name)[name]
        if values is not None and values.size and values.dtype.kind in "fiub" and values.ndim < 3:
            yield name
