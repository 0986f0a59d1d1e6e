"""Writes report.html: the data of its curves, and a section for each thing it shows."""

import base64
import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib.resources import files
from importlib.resources.abc import Traversable
from importlib.util import find_spec
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.signals import Array
from stepbus_participant import ExtraMissing, lacks
from stepbus_tools.columns import dotted
from stepbus_tools.report.charts import ChartLine, Role
from stepbus_tools.report.curves import Curve
from stepbus_tools.viewing.render import pixels_of
from stepbus_tools.whole_file import replaced

from .content import RunPage, groups, path_of
from .step_times import lateness_html, times_html
from .svg import figure, path_from_above

PAGE_FILE = "report.html"
_WIDEST = 480
"""Pixels of a camera still; a larger one is thinned."""
_MOST_POINTS = 2000
_MOST_WARNINGS = 10
_FEW_EVENTS = 30
_STYLES: Mapping[Role, Mapping[str, object]] = {
    "measured": {},
    "error": {"color": 3},
    "reference": {"dash": True, "color": 1},
    "command": {"dash": True, "color": 1},
    "target": {"dash": True, "color": 2},
}
"""What a line is → how the script draws it."""


def write_page(
    paths: Sequence[Path], target: Path | None = None, problems: list[str] | None = None
) -> Path:
    """Write the page of a run, or of several beside each other; return its path.

    paths: of recordings, or the folders of their runs. target: default: report.html beside the
    first recording. problems: gets what cannot be shown.

    Raises RecordingFailed when a recording cannot be read or the page cannot be written,
    ExtraMissing without uPlot.
    """
    runs = [RunPage(path) for path in paths]
    if problems is not None:
        problems += [f"{run.path}: {text}" for run in runs for text in run.problems]
    return render_page(runs, target or runs[0].path.with_name(PAGE_FILE))


def render_page(runs: Sequence[RunPage], target: Path) -> Path:
    """Write the page of runs that have been read; raises as `write_page`."""
    library, assets = _uplot(), files(__package__ or "") / "assets"
    if len(runs) > 1:
        folders = [run.path.parent.name or run.path.stem for run in runs]
        for run, folder in zip(runs, folders, strict=True):
            run.label = folder if len(set(folders)) == len(folders) else str(run.path)
    title = " · ".join(dict.fromkeys(run.name for run in runs))
    text = Template(_read(assets / "page.html")).substitute(
        title=escape(f"{title}: {'comparison' if len(runs) > 1 else 'report'}"),
        head="".join(map(_head, runs)),
        stills=_section("The scene at its end", _scenes(runs)),
        pictures=_section("Camera", "".join(map(_camera_stills, runs))),
        path=_section("Path of the base, from above", path_from_above(_paths(runs))),
        happenings=_section("Events and faults", _events(runs)),
        timing=_section("Step times", "".join(map(_times, runs))),
        again=_section("Run it again", "".join(map(_again, runs))),
        style=_read(library / "uPlot.min.css") + _read(assets / "page.css"),
        library=_read(library / "uPlot.iife.js"),
        data=_script(_data(runs)),
        script=_read(assets / "page.js"),
    )
    with replaced(target) as part:
        part.write_text(text, encoding="utf-8")
    return target


def _uplot() -> Path:
    """Return the folder of uPlot, which the package uplot-python carries."""
    # It is not imported: that would load IPython.
    spec = find_spec("uplot")
    for place in (spec.submodule_search_locations or ()) if spec else ():
        if (static := Path(place) / "static").is_dir():
            return static
    raise ExtraMissing(lacks("the page", "uplot"))


def _read(file: Traversable) -> str:
    return file.read_text("utf-8")


def _script(value: object) -> str:
    """Return JSON that ends no script."""
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")


# --- the charts ---------------------------------------------------------------------------


class _Arrays:
    """All numbers of a page as base64; equal arrays, such as the times of most, are there once."""

    def __init__(self) -> None:
        self._places: dict[bytes, int] = {}

    def line(self, line: ChartLine) -> dict[str, Any]:
        """Return a line of a chart, as the script takes it."""
        curve = Curve(_MOST_POINTS)
        t, values = line.points
        curve.add(t, np.where(np.isfinite(values), values, np.nan)[:, None])
        t, values = curve.line(0)
        at, y = self._place(b"d", t.astype("<f8")), self._place(b"f", values.astype("<f4"))
        return {"label": line.label, "t": at, "y": y, **_STYLES[line.role]}

    def encoded(self) -> list[str]:
        """Return each array: `d` or `f`, then its little-endian numbers as base64."""
        return [data[:1].decode() + base64.b64encode(data[1:]).decode() for data in self._places]

    def _place(self, form: bytes, values: Array) -> int:
        return self._places.setdefault(form + values.tobytes(), len(self._places))


def _data(runs: Sequence[RunPage]) -> Mapping[str, Any]:
    """Return what the script shows: all charts, marks, and their last time [s]."""
    arrays = _Arrays()
    ends_s = [t for run in runs for t in (run.end_s, *(one.t_ns * 1e-9 for one in run.events))]
    return {
        "groups": _groups(runs, arrays),
        "marks": [
            {"t": one.t_ns * 1e-9, "level": one.level}
            for run in runs
            for one in run.events
            if one.level != "info" or len(run.events) <= _FEW_EVENTS
        ],
        # What ended a run comes a step behind its last message.
        "end": max(ends_s),
        "arrays": arrays.encoded(),
    }


def _groups(runs: Sequence[RunPage], arrays: _Arrays) -> list[Mapping[str, Any]]:
    """Return the groups of all runs: each chart once, with the lines of all in it."""
    merged: dict[str, tuple[bool, dict[tuple[str, str], dict[str, Any]]]] = {}
    for number, run in enumerate(runs):
        for group in groups(run):
            _, charts = merged.setdefault(group.title, (group.is_open, {}))
            for chart in group.charts:
                row = {"title": chart.title, "unit": chart.unit, "limits": chart.limits}
                kept = charts.setdefault((chart.title, chart.unit), {**row, "lines": []})
                seen = {(line["t"], line["y"]) for line in kept["lines"]}
                for line in map(arrays.line, chart.lines):
                    if not run.label:
                        kept["lines"].append(line)
                    # What is the same for all, such as a reference, is there once.
                    elif (line["t"], line["y"]) not in seen or not line.get("dash"):
                        label = f"{run.label} {line['label']}"
                        kept["lines"].append({**line, "label": label, "color": number})
    return [
        {"title": title, "open": is_open, "charts": list(charts.values())}
        for title, (is_open, charts) in merged.items()
    ]


# --- the rest -----------------------------------------------------------------------------


def _section(title: str, content: str) -> str:
    return f"<section><h2>{title}</h2>{content}</section>" if content else ""


def _head(run: RunPage) -> str:
    result = run.result
    name = escape(run.name + (f" ({run.label})" if run.label else ""))
    verdict, why = "unknown", "There is no result.json beside the recording."
    problems = list(run.problems)
    if result is not None:
        verdict, why = result.outcome, result.reason
        why = "It ran to its end." if why == verdict else why
        if result.exit_code and result.participant:
            why += f" ({result.participant}, step {result.at_step}, exit code {result.exit_code})"
        warnings = result.warnings[:_MOST_WARNINGS]
        problems += [f"{w.level}: {w.source}, step {w.step}: {w.text}" for w in warnings]
    shown = "".join(f'<p class="problem">{escape(text)}</p>' for text in problems)
    lines = "".join(f"<li>{escape(line)}</li>" for line in run.lines)
    cells = "".join(
        f"<div><dt>{key}</dt><dd>{escape(value)}</dd></div>" for key, value in _facts(run)
    )
    return (
        f'<header><h1>{name} <span class="verdict {escape(verdict)}">{escape(verdict)}</span></h1>'
        f'<p class="reason">{escape(why)}</p>{shown}<dl>{cells}</dl>'
        f"{f'<ul>{lines}</ul>' if lines else ''}</header>"
    )


def _facts(run: RunPage) -> Iterator[tuple[str, str]]:
    result = run.result
    yield "recording", str(run.path)
    if result is None:
        yield "last step", str(run.last_step)
        return
    yield "steps", f"{result.steps} of {result.step_ns * 1e-6:g} ms"
    yield "simulated", f"{result.simulated_s:g} s"
    yield "wall time", f"{result.wall_s:.2f} s, {result.real_time_factor:.2f} × real time"
    yield "seed, window, transport", f"{result.seed}, {result.window}, {result.transport}"
    if result.faults:
        yield "faults", ", ".join(result.faults)
    drops = ", ".join(f"{count} by {name}" for name, count in result.drops.items() if count)
    if drops:
        yield "dropped messages", drops
    yield "sha256", result.sha256[:16]


def _scenes(runs: Sequence[RunPage]) -> str:
    rows = [
        figure(run.still, f"{run.label} t = {run.end_s:.2f} s".strip())
        for run in runs
        if run.still is not None
    ]
    return f'<div class="stills scene">{"".join(rows)}</div>' if rows else ""


def _camera_stills(run: RunPage) -> str:
    rows = []
    for camera in run.cameras:
        for t, image in camera.images:
            every = -(-image.width // _WIDEST) or 1
            try:
                pixels = pixels_of(image)[::every, ::every]
            except ValueError:
                continue
            rows.append(figure(pixels, f"{dotted(camera.port)}, t = {t:.2f} s"))
    return f'<div class="stills">{"".join(rows)}</div>' if rows else ""


def _paths(runs: Sequence[RunPage]) -> dict[str, Array]:
    return {
        f"{run.label} {port.name}".strip(): points
        for run in runs
        for port in run.ports
        if len(points := path_of(port))
    }


def _events(runs: Sequence[RunPage]) -> str:
    rows = "".join(
        f'<tr class="{escape(one.level)}"><td>{one.t_ns * 1e-9:.3f} s</td>'
        f"<td>{escape(run.label)}</td><td>{escape(one.level)}</td><td>{escape(one.source)}</td>"
        f"<td>{escape(one.text)}</td></tr>"
        for run in runs
        for one in run.events
    )
    left = sum(run.events_left for run in runs)
    more = f"<p>{left} more are in the recording.</p>" if left else ""
    return f"<div class=scroll><table>{rows}</table></div>{more}" if rows else ""


def _times(run: RunPage) -> str:
    if not run.times:
        return ""
    late = run.result.real_time if run.result else None
    title = f"<h3>{escape(run.label)}</h3>" if run.label else ""
    return title + times_html(run.times) + (lateness_html(late) if late else "")


def _again(run: RunPage) -> str:
    rows = [f"stepbus rerun {shlex.quote(str(run.path))}"]
    if run.result is not None and run.result.file:
        sets = "".join(f" --set {shlex.quote(text)}" for text in run.result.overrides)
        rows.insert(0, f"stepbus run {shlex.quote(run.result.file)}{sets}")
    return "".join(f"<pre>{escape(row)}</pre>" for row in rows)
