"""The curves of a page: the numbers that its script draws."""

import base64
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from typing import Any

import numpy as np

from stepbus_tools.report.charts import Chart, ChartLine
from stepbus_tools.report.curves import Curve
from stepbus_tools.signals import Array
from stepbus_tools.theme import engineering, line_style, prefixed

from .content import Group, RunPage

_MOST_POINTS = 2000
_BAR = files(__package__ or "") / "assets" / "curves.html"
_PAST = 1.03
"""The time axis reaches so far beyond a mark at the end of a run."""


class Curves:
    """All charts of some runs, each once, with the lines of all runs in it."""

    def __init__(self, runs: Sequence[RunPage]) -> None:
        self._runs = runs
        self.groups = _merged(runs)
        self.marks = [mark for run in runs for mark in run.marks]
        last = max(run.end_s for run in runs)
        marked = max((mark.t for mark in self.marks if mark.level != "info"), default=0.0)
        # What ended a run comes a step after its last message.
        self.end_s = max(last, _PAST * marked if _PAST * marked > last else 0.0)

    def data(self) -> Mapping[str, Any]:
        """Return the data of the page's script, as JSON-compatible values."""
        arrays = _Arrays()
        return {
            "groups": [
                {
                    "title": group.title,
                    "open": group.is_open,
                    "color": group.color,
                    "charts": [arrays.chart(chart) for chart in group.charts],
                }
                for group in self.groups
            ],
            "runs": [run.label for run in self._runs],
            "marks": [{"t": m.t, "level": m.level, "text": m.sentence} for m in self.marks],
            "end": self.end_s,
            "arrays": arrays.encoded(),
        }

    def html(self) -> str:
        """Return the toolbar above the curves, as HTML; empty without curves."""
        return _BAR.read_text("utf-8") if self.groups else ""


def _said(chart: Chart) -> str:
    """Return the summary of a chart: its largest value, or the share of its limit."""
    if chart.used is not None:
        share = f"{100 * chart.used:.0f}" if chart.used >= 0.01 or not chart.used else "< 1"
        return f"{share} % of limit used"
    lowest = [float(np.nanmin(line.points[1], initial=0.0)) for line in chart.lines]
    is_negative = chart.largest > 0 and -min(lowest, default=0.0) >= chart.largest
    size, _, unit = engineering(chart.largest, chart.unit).partition(" ")
    return f"at most {f'|{size}|' if is_negative else size} {unit}".strip()


def _merged(runs: Sequence[RunPage]) -> list[Group]:
    found: dict[str, tuple[Group, dict[tuple[str, str], Chart]]] = {}
    for number, run in enumerate(runs):
        for group in run.groups:
            _, charts = found.setdefault(group.title, (group, {}))
            for chart in group.charts:
                key = (chart.title, chart.unit)
                known = charts.setdefault(key, replace(chart, lines=[]))
                lines = list(_of_run(run, number, chart, known))
                charts[key] = replace(known, lines=[*known.lines, *lines])
    return [replace(group, charts=list(charts.values())) for group, charts in found.values()]


def _of_run(run: RunPage, number: int, chart: Chart, known: Chart) -> Iterator[ChartLine]:
    """Yield the lines that a run adds; what is the same for all, as a reference, is there once."""
    for line in chart.lines:
        if line.is_solid or not any(_is_same(line, one) for one in known.lines):
            label = f"{run.label} {line.label}".strip()
            yield replace(line, label=label, run=number)


def _is_same(line: ChartLine, other: ChartLine) -> bool:
    rows = zip(line.points, other.points, strict=True)
    return all(np.array_equal(one, two, equal_nan=True) for one, two in rows)


class _Arrays:
    """All numbers of a page as base64; equal arrays, such as the times of most, are there once."""

    def __init__(self) -> None:
        self._places: dict[bytes, int] = {}

    def chart(self, chart: Chart) -> Mapping[str, Any]:
        """Return a chart, as the script takes it."""
        return {
            "title": chart.title,
            "unit": chart.unit,
            "said": _said(chart),
            "scale": prefixed(chart.largest, chart.unit),
            "limits": chart.limits,
            "near": chart.is_near_limit,
            "lines": [self._line(line) for line in chart.drawn],
        }

    def _line(self, line: ChartLine) -> Mapping[str, Any]:
        curve, style = Curve(_MOST_POINTS), line_style(line.number)
        t, values = line.points
        # The script has single precision, which holds no 1e200.
        is_held = np.abs(values) < np.finfo(np.float32).max
        curve.add(t, np.where(is_held, values, np.nan)[:, None])
        t, values = curve.line(0)
        return {
            "label": line.label,
            "t": self._place(b"d", t.astype("<f8")),
            "y": self._place(b"f", values.astype("<f4")),
            "role": line.role,
            "color": style.color,
            "broken": style.is_broken,
            "run": line.run,
        }

    def encoded(self) -> list[str]:
        """Return each array: `d` or `f`, then its little-endian numbers as base64."""
        return [data[:1].decode() + base64.b64encode(data[1:]).decode() for data in self._places]

    def _place(self, form: bytes, values: Array) -> int:
        return self._places.setdefault(form + values.tobytes(), len(self._places))
