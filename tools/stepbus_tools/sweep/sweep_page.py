"""The page of a sweep: one HTML file that opens without a network."""

import json
import math
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from operator import itemgetter
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

from stepbus_tools.sweep.rows import Journal, ResultRow
from stepbus_tools.sweep.spec import Plan, Spec
from stepbus_tools.sweep.sweep_metrics import BUILTIN, UNITS
from stepbus_tools.theme import MARK, png_figure, style_sheet, uplot
from stepbus_tools.whole_file import replaced

PAGE_FILE = "report.html"
_MOST_ROWS = 20_000
_MOST_CAUSES = 50
_FIRST = ("rmse", "success")


def write_page(
    journal: Journal,
    plan: Plan,
    paths: Sequence[str],
    folder: Path,
    pictures: Mapping[str, Path],
) -> None:
    """Write the page of all rows so far.

    A sweep of more than 20,000 rows shows every n-th. paths: of the axes. pictures: title → PNG.

    Raises RecordingFailed when it cannot be written.
    """
    library, library_style = uplot("the report of a sweep")
    every = math.ceil(len(journal) / _MOST_ROWS) or 1
    rows = [row for index, row in enumerate(journal.values()) if index % every == 0]
    failed = sum(row.exit_code != 0 for row in journal.values())
    part = f" The charts show {len(rows)} of them." if every > 1 else ""
    word = f"{failed} of {len(journal)} failed" if failed else "all finished"
    note = "; the red crosses" if failed else ""
    number = rows[0].run if rows else 0
    room = files(__package__ or "")
    text = Template((room / "page.html").read_text("utf-8")).substitute(
        title=escape(f"Sweep of {plan.spec.scenario}"),
        icon=quote(MARK),
        style=style_sheet() + library_style,
        mark=MARK + "stepbus",
        verdict=f'<span class="verdict{" failed" if failed else ""}">{word}</span>',
        summary=f"<b>{len(journal)}</b> runs, <b>{failed}</b> failed{note}.{part}",
        pictures="".join(png_figure(path.read_bytes(), title) for title, path in pictures.items()),
        failures=_failures(journal),
        again=(
            f"<pre>stepbus rerun {escape(folder.name)} {number}</pre><p>repeats run {number} "
            "in separate processes and compares the SHA-256 of its recording.</p>"
        ),
        library=library,
        # JSON that ends no script.
        data=json.dumps(_data(journal, plan, paths, rows)).replace("</", "<\\/"),
        script=(room / "page.js").read_text("utf-8"),
    )
    with replaced(folder / PAGE_FILE) as target:
        target.write_text(text, encoding="utf-8")


def _data(
    journal: Journal, plan: Plan, paths: Sequence[str], rows: Sequence[ResultRow]
) -> dict[str, Any]:
    names = dict.fromkeys(name for row in rows for name in row.metrics)
    columns = {name: [_number(row.metrics.get(name)) for row in rows] for name in names}
    metrics = _numeric(rows)
    varied = {path: [_shown(row.values.get(path)) for row in rows] for path in paths}
    return {
        "axes": list(paths),
        "metrics": metrics,
        "metric": primary_metric(plan.spec, metrics),
        "logarithmic": [axis.paths[0] for axis in plan.axes if axis.is_log],
        "columns": {**columns, **varied},
        "run": [row.run for row in rows],
        "failed": [row.exit_code != 0 for row in rows],
        "units": {name: unit for name, unit in UNITS.items() if name in columns},
        "extremes": {row.run: name for name, row in extremes(journal, plan.spec).items()},
    }


def primary_metric(spec: Spec, metrics: Sequence[str]) -> str:
    """Return the metric that a sweep is about: the optimizer's, the user's first, or ours."""
    own = [name for name in metrics if name not in BUILTIN and not name.startswith("rmse")]
    wanted = [spec.optimize or "", *own, *_FIRST]
    return next((name for name in wanted if name in metrics), metrics[0] if metrics else "")


def extremes(journal: Journal, spec: Spec) -> dict[str, ResultRow]:
    """Return the rows with the smallest and the largest primary metric, `best` and `worst`.

    Only `best` where all are equal; none without a metric.
    """
    finished = [row for row in journal.values() if row.exit_code == 0]
    # Of all of them: the metric may have raised in the first.
    metric = primary_metric(spec, _numeric(finished))
    measured = [(_number(row.metrics.get(metric)), row) for row in finished]
    known = [(value, row) for value, row in measured if value is not None]
    if not known:
        return {}
    low, high = (pick(known, key=itemgetter(0)) for pick in (min, max))
    best, worst = (high, low) if spec.maximize else (low, high)
    return {"best": best[1]} | ({"worst": worst[1]} if worst[1] is not best[1] else {})


def _numeric(rows: Sequence[ResultRow]) -> list[str]:
    """Return the metrics that are a number in some row."""
    names = dict.fromkeys(name for row in rows for name in row.metrics)
    return [n for n in names if any(_number(row.metrics.get(n)) is not None for row in rows)]


def _number(value: object) -> float | None:
    """Return a metric as a number; None for text, and for what JSON cannot write."""
    if isinstance(value, int | float) and math.isfinite(value):
        return float(value)
    return None


def _shown(value: object) -> float | int | str | None:
    if value is None or (isinstance(value, int | float) and not isinstance(value, bool)):
        return value
    return value if isinstance(value, str) else json.dumps(value)


def _failures(journal: Journal) -> str:
    """Return the causes of failures, the most frequent first; nothing where no run failed."""
    causes: dict[tuple[str, str], list[int]] = {}
    for row in journal.values():
        if row.exit_code:
            causes.setdefault((row.outcome, row.reason or row.metric_error), []).append(row.run)
        elif row.metric_error:
            causes.setdefault(("no metric", row.metric_error), []).append(row.run)
    if not causes:
        return ""
    rows = sorted(causes.items(), key=lambda item: -len(item[1]))[:_MOST_CAUSES]
    cells = "".join(
        f"<tr><td>{len(runs)}</td><td>{escape(outcome)}</td>"
        f'<td class="text">{escape(reason if len(reason) <= 200 else f"{reason[:200]} …")}</td>'
        f"<td>{', '.join(map(str, runs[:8]))}{' …' if len(runs) > 8 else ''}</td></tr>"
        for (outcome, reason), runs in rows
    )
    return (
        "<h2>Failures by cause</h2><table tabindex=0>"
        f"<tr><th>runs</th><th>outcome</th><th>reason</th><th>which</th></tr>{cells}</table>"
    )
