"""How several runs differ, in figures: the largest error of each joint, run by run."""

from collections.abc import Sequence
from html import escape

from stepbus_tools.report.charts import Chart
from stepbus_tools.report.units import engineering

from .content import RunPage

_SAME = 1e-12


def comparison_html(runs: Sequence[RunPage]) -> str:
    """Return a table of each joint's largest error, and by how much others differ from the first.

    It is empty for one run, or without errors.
    """
    errors = [_errors(run) for run in runs]
    joints = list(dict.fromkeys(joint for found in errors for joint in found))
    if len(runs) < 2 or not joints:
        return ""
    names = "".join(f"<th>{escape(run.label)}</th>" for run in runs)
    rows = "".join(
        f"<tr><td>{escape(joint)}</td>"
        + "".join(f"<td>{_cell(found.get(joint), errors[0].get(joint))}</td>" for found in errors)
        + "</tr>"
        for joint in joints
    )
    return (
        f"<div class=scroll tabindex=0><table><tr><th>largest error</th>{names}</tr>{rows}"
        "</table></div>"
    )


def _errors(run: RunPage) -> dict[str, Chart]:
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
    text = engineering(chart.largest, chart.unit)
    if first is None or first is chart or first.largest <= _SAME:
        return escape(text)
    share = 100 * (chart.largest / first.largest - 1)
    return escape(f"{text} ({share:+.0f} %)")
