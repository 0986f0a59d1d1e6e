"""How several runs differ, in figures: a column for each run, and by how much it differs."""

from collections.abc import Iterator, Sequence
from html import escape

from stepbus_tools.report.charts import Chart
from stepbus_tools.report.figure_html import run_sample
from stepbus_tools.report.units import engineering

from .content import RunPage
from .head import figures

_SAME = 1e-12


def comparison_html(runs: Sequence[RunPage]) -> str:
    """Return a table: outcome, settings, errors of joints, the figures that matter, run by run.

    An error has by how much it differs from that of the first run. It is empty for one run.
    """
    if len(runs) < 2:
        return ""
    names = "".join(
        f"<th>{run_sample(number)}{escape(run.label)}</th>" for number, run in enumerate(runs)
    )
    rows = "".join(
        f"<tr><th>{escape(name)}</th>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"
        for name, cells in [*_outcomes(runs), *_errors(runs), *_figures(runs)]
    )
    note = f"In parentheses: change from {runs[0].label}." if list(_errors(runs)) else ""
    return (
        f"<div class=scroll tabindex=0><table class=comparison><tr><td></td>{names}</tr>{rows}"
        f'</table></div><p class="note">{escape(note)}</p>'
    )


_Rows = Iterator[tuple[str, list[str]]]


def _outcomes(runs: Sequence[RunPage]) -> _Rows:
    words = [run.result.outcome if run.result else "unknown" for run in runs]
    yield "outcome", [f'<span class="word {escape(word)}">{escape(word)}</span>' for word in words]
    given = [_given(run) for run in runs]
    if any(given):
        yield "settings, faults", ["<br>".join(map(escape, texts)) or "–" for texts in given]


def _given(run: RunPage) -> list[str]:
    """Return what the run was given that its scenario does not say."""
    return [*run.result.overrides, *run.result.faults] if run.result else []


def _errors(runs: Sequence[RunPage]) -> _Rows:
    """Yield the largest error of each joint."""
    errors = [_charts(run) for run in runs]
    for joint in dict.fromkeys(joint for charts in errors for joint in charts):
        first = errors[0].get(joint)
        yield f"largest error, {joint}", [_cell(charts.get(joint), first) for charts in errors]


def _figures(runs: Sequence[RunPage]) -> _Rows:
    shown = [dict(figures(run)) for run in runs]
    names = dict.fromkeys(name for row in shown for name in row)
    for name in names:
        if not name.startswith("largest error"):
            yield name, [escape(row.get(name, "–")) for row in shown]


def _charts(run: RunPage) -> dict[str, Chart]:
    """Return joint → the chart of its error."""
    return {
        group.title: chart
        for group in run.groups
        for chart in group.charts
        if chart.title == "error" and group.title in run.joints.measured
    }


def _cell(chart: Chart | None, first: Chart | None) -> str:
    if chart is None:
        return "–"
    text = escape(engineering(chart.largest, chart.unit))
    if first is None or first is chart or first.largest <= _SAME:
        return text
    share = round(100 * (chart.largest / first.largest - 1))
    kind = "less" if share < 0 else "more" if share else "same"
    sign = {"less": "−", "more": "+", "same": "±"}[kind]
    return f'{text} <span class="{kind}">({sign}{abs(share)}\u00a0%)</span>'
