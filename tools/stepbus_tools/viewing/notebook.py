"""How recordings and results look in a notebook."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Port, Recording
from stepbus_orchestrator.run.result import Result
from stepbus_tools.columns import dotted
from stepbus_tools.report.charts import find_signals, signal_names
from stepbus_tools.report.picture import draw
from stepbus_tools.theme import PAPER, figure
from stepbus_tools.viewing.exports.scene_file import scene_at_end
from stepbus_tools.viewing.page import PAGE_FILE
from stepbus_tools.whole_file import replaced

_MOST_NAMES = 8
_MOST_SIGNALS = 4
_BADGE = "padding:.1em .6em;border-radius:1em;color:#fff;background:"
_COLORS = {"finished": "good", "failed": "bad"}


@dataclass(frozen=True)
class Plot:
    """A picture of signals; a notebook shows it. png: its bytes."""

    png: bytes

    def save(self, path: str | Path) -> Path:
        """Write it as a PNG file; raises RecordingFailed when it cannot be written."""
        target = Path(path)
        with replaced(target) as part:
            part.write_bytes(self.png)
        return target

    def __repr__(self) -> str:
        """Return its size."""
        return f"<Plot, {len(self.png)} bytes of PNG>"

    def _repr_png_(self) -> bytes:
        return self.png


def plot(recording: Recording, signals: Sequence[str]) -> Plot:
    """Return a picture of signals, one panel each.

    signals: as of `stepbus plot`; none: the positions of all joints, else the first four signals.
    Raises WiringError for one that the recording does not have, ExtraMissing without matplotlib.
    """
    joints = [port for port in recording.of_type("JointState/1") if port.last_step >= 0]
    positions = [f"{dotted(port)}.position" for port in joints]
    texts = list(signals) or positions or signal_names(recording)[:_MOST_SIGNALS]
    charts = [chart for text in texts for chart in find_signals(recording, text)]
    if not charts:
        raise RecordingFailed(f"{recording.path} has no numbers to plot")
    return Plot(draw(str(recording.path), charts))


def recording_html(recording: Recording) -> str:
    """Return a recording as a table of its ports, with a still of its scene."""
    ports = [port for port in recording.ports.values() if not port.topic.startswith("stepbus/")]
    rows = "".join(map(_row, ports))
    why = recording.cut_short
    damage = f"<p>The recording <b>{escape(why)}</b>.</p>" if why else ""
    scene = scene_at_end(recording)
    still = "" if scene is None else figure(scene, "the scene at its end", PAPER["raised"])
    return (
        f"<div><p><b>{escape(str(recording.path))}</b>, up to step {recording.last_step}</p>"
        f"{damage}{still}<table><tr><th>port</th><th>type</th><th>names</th>"
        f"<th>until</th></tr>{rows}</table></div>"
    )


def _row(port: Port) -> str:
    last = port.last
    names = list(port.names)
    more = f", … ({len(names)})" if len(names) > _MOST_NAMES else ""
    until = "no message" if last is None else f"{last.t_ns * 1e-9:g} s"
    cells = (port.topic, port.type, ", ".join(names[:_MOST_NAMES]) + more, until)
    return f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"


def result_html(result: Result) -> str:
    """Return a result: outcome, reason, figures, warnings, and a link to its page."""
    colour = PAPER[_COLORS.get(result.outcome, "soft")]
    badge = f'<span style="{_BADGE}{colour}">{escape(result.outcome)}</span>'
    rows = "".join(
        f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>"
        for name, value in _facts(result)
    )
    warnings = "".join(
        f"<li>{escape(f'{one.level}: {one.source}: {one.text}')}</li>"
        for one in result.warnings[:_MOST_NAMES]
    )
    page = Path(result.folder) / PAGE_FILE
    link = f'<p><a href="{escape(str(page))}">{escape(str(page))}</a></p>' if page.exists() else ""
    return (
        f"<div><p><b>{escape(result.scenario)}</b> {badge} {escape(result.reason)}</p>"
        f"<table>{rows}</table>{f'<ul>{warnings}</ul>' if warnings else ''}{link}</div>"
    )


def _facts(result: Result) -> Iterator[tuple[str, str]]:
    if result.exit_code:
        yield "who, when", f"{result.participant or 'orchestrator'}, step {result.at_step}"
    yield "steps", f"{result.steps} of {result.step_ns * 1e-6:g} ms ({result.simulated_s:g} s)"
    yield "wall time", f"{result.wall_s:.2f} s, {result.real_time_factor:.1f} × real time"
    yield "recording", str(result.recording)
    yield "sha256", result.sha256
