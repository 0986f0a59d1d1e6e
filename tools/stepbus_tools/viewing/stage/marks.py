"""What happened in a run, as marks: on the slider of its time, in its curves, in a list."""

import contextlib
import html
from collections.abc import Iterable, Sequence
from pathlib import Path

from stepbus_orchestrator.recording import Recording, layout
from stepbus_orchestrator.run.result import Result, result_beside
from stepbus_schemas import StepbusError
from stepbus_tools.report.charts import Mark

_SIGNS = {
    "fault": "✕", "failure": "✕", "error": "✕", "warning": "▲", "divergence": "≠",
    "goal": "•", "call": "•", "info": "•",
}  # fmt: skip
"""Level → its sign on the slider; front.css has the colours of these. The serious come first."""
_ORDER = tuple(_SIGNS)
_MOST_ON_SLIDER = 24
_NEAR = 0.04
"""Of the slider: so near to its end, a sign takes the place of the number there."""


def on_slider(marks: Iterable[Mark], end_s: float) -> tuple[tuple[float, str], ...]:
    """Return the marks of a slider, with their signs: the most serious ones where there are many.

    end_s: of the slider, which has its ends as marks too, where there is room.
    """
    by_time: dict[float, str] = {}
    for mark in sorted(marks, key=lambda one: _ORDER.index(one.level)):
        if len(by_time) < _MOST_ON_SLIDER and mark.t <= end_s + 1e-9:
            by_time.setdefault(round(mark.t, 6), _SIGNS[mark.level])
    ends = {0.0: "0", end_s: f"{end_s:.3g}"}
    near = _NEAR * end_s
    ends = {at: text for at, text in ends.items() if all(abs(at - t) > near for t in by_time)}
    return tuple(sorted((ends | by_time).items()))


def listed(marks: Sequence[Mark], most: int) -> str:
    """Return the last marks as HTML; their text comes from the author of the recording."""
    rows = "".join(
        f'<li data-level="{html.escape(mark.level)}">{html.escape(mark.label)}</li>'
        for mark in marks[-most:]
    )
    return f'<ul class="lines">{rows or "<li>nothing yet</li>"}</ul>'


def result_in(folder: Path) -> Result | None:
    """Return the result of the run in a folder; None where there is none."""
    with contextlib.suppress(StepbusError, OSError), Recording(folder / layout.RUN_FILE) as run:
        return result_beside(run)
    return None


def failure_banner(result: Result | None, run: str = "") -> str:
    """Return that and why a run failed, as HTML; nothing of one that did not. run: its name."""
    if result is None or not result.exit_code:
        return ""
    who, why = html.escape(f"{run} failed".strip()), html.escape(result.cause or result.reason)
    return f'<div class="failed" role="alert"><b>{who}</b>: {why}</div>'
