"""Small curves as SVG: they are there without a script, on paper and in a preview."""

import math
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from html import escape

import numpy as np

from stepbus_tools.look import line_style
from stepbus_tools.report.charts import Chart, ChartLine, Mark
from stepbus_tools.report.curves import Curve
from stepbus_tools.report.units import prefixed

_WIDTH, _HEIGHT = 300.0, 118.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 42.0, 296.0, 8.0, 100.0
_DIGIT, _ABOVE = 6.0, 11.0
"""Width of a digit, and height of a line of text."""
_MOST_POINTS = 240
_ROOM = 0.06
_LONGEST = 8
"""Characters beside a tick."""
_SAID = ("failure", "fault")
_MOST_SAID = 3
_Place = Callable[[float], float]
_Parts = Iterator[str]


def small_chart(chart: Chart, marks: Sequence[Mark], end_s: float) -> str:
    """Return a chart as a picture. end_s: where its time axis ends [s]."""
    low, high = _range(chart)
    factor, unit = scale_of(chart)
    ticks = nice_ticks(low * factor, high * factor, 4)
    labels, base = labels_of(ticks)
    left = max(_LEFT, 8 + _DIGIT * max(map(len, labels), default=0))

    def x(t: float) -> float:
        return left + (_RIGHT - left) * t / (end_s or 1.0)

    def y(value: float) -> float:
        return _BOTTOM - (_BOTTOM - _TOP) * (value - low) / (high - low)

    above = _ABOVE if base else 0.0
    parts = [f'<text x="2" y="{_TOP - _ABOVE:g}">{base}</text>'] if base else []
    for tick, text in zip(ticks, labels, strict=True):
        parts += _row(text, left, y(tick / factor))
    parts += _times(end_s, x)
    parts += [
        f'<path class="limit" d="M{left:g} {y(limit):.1f}H{_RIGHT:g}"/>'
        for limit in chart.limits
        if low <= limit <= high
    ]
    # What ended the run lies above all else.
    ordered = sorted(marks, key=lambda one: one.level == "failure")
    parts += [
        f'<path class="mark {escape(one.level)}" d="M{x(one.t):.1f} {_TOP:g}V{_BOTTOM:g}"/>'
        for one in ordered
    ]
    said = [one for one in reversed(ordered) if one.level in _SAID][:_MOST_SAID]
    parts += [_word(one.level, x(one.t), row) for row, one in enumerate(said)]
    parts += [_path(line, x, y) for line in chart.drawn]
    label = f"{chart.title} [{unit}] over time [s]" if unit else f"{chart.title} over time [s]"
    return (
        f'<svg class="small" role="img" aria-label="{escape(label)}" '
        f'viewBox="0 {-above:g} {_WIDTH:g} {_HEIGHT + above:g}">{"".join(parts)}</svg>'
    )


def _word(level: str, at: float, row: int) -> str:
    """Return what a line is, beside it. row: below the words of others."""
    anchor, shift = ("end", -3) if at > (_LEFT + _RIGHT) / 2 else ("start", 3)
    return (
        f'<text class="{escape(level)}" x="{at + shift:.1f}" y="{_TOP + 8 + 11 * row:g}" '
        f'text-anchor="{anchor}">{escape(level)}</text>'
    )


def scale_of(chart: Chart) -> tuple[float, str]:
    """Return by what the numbers of a chart are multiplied to be shown, and their unit then."""
    return prefixed(max(map(abs, _range(chart))), chart.unit)


def _range(chart: Chart) -> tuple[float, float]:
    """Return the lower and upper end of the values' axis."""
    values = [line.points[1][np.isfinite(line.points[1])] for line in chart.lines]
    numbers = np.concatenate([*values, np.array(chart.limits if chart.is_near_limit else ())])
    low, high = (float(numbers.min()), float(numbers.max())) if len(numbers) else (0.0, 1.0)
    if high - low <= 1e-12 * max(abs(low), abs(high), 1e-300):
        room = abs(high) or 1.0
        return low - room, high + room
    room = _ROOM * (high - low)
    return low - room, high + room


def nice_ticks(low: float, high: float, most: int) -> list[float]:
    """Return at most so many round numbers between two."""
    span = high - low
    if not (math.isfinite(span) and span / most >= sys.float_info.min):
        return [low]
    size = 10 ** math.floor(math.log10(span / most))
    step = next(size * k for k in (1, 2, 5, 10, 20) if span / (size * k) <= most)
    first = math.ceil(low / step - 1e-9)
    return [step * n for n in range(first, math.floor(high / step + 1e-9) + 1)]


def labels_of(ticks: Sequence[float]) -> tuple[list[str], str]:
    """Return ticks as short texts that differ, and what is to be added to them, if anything."""
    if len(ticks) < 2:
        # With an exponent of three digits, there is room for two.
        return [_brief(f"{tick:.{2 if 0 < abs(tick) < 1e-99 else 3}g}") for tick in ticks], ""
    step = (ticks[-1] - ticks[0]) / (len(ticks) - 1)
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    plain = [f"{tick + 0.0:.{digits}f}" for tick in ticks]
    if max(map(len, plain)) <= _LONGEST:
        return plain, ""
    brief = [_brief(f"{0.0 if abs(tick) < 1e-6 * step else tick:.3g}") for tick in ticks]
    rows = zip(ticks, brief, strict=True)
    if all(abs(float(text) - tick) < 1e-3 * step for tick, text in rows):
        return brief, ""
    return [_brief(f"+{number * step:.2g}") for number in range(len(ticks))], f"{plain[0]} +"


def _brief(number: str) -> str:
    """Return 2e-7 for 2e-07."""
    return re.sub(r"e([+-])0*", lambda sign: "e-" if sign[1] == "-" else "e", number)


def _row(label: str, left: float, at: float) -> _Parts:
    yield f'<path class="grid" d="M{left:g} {at:.1f}H{_RIGHT:g}"/>'
    yield f'<text x="{left - 4:g}" y="{at + 3:.1f}" text-anchor="end">{label}</text>'


def _times(end_s: float, x: _Place) -> _Parts:
    ticks = nice_ticks(0.0, end_s, 5)
    for tick in ticks:
        at, unit = x(tick), " s" if tick == ticks[-1] else ""
        anchor = "end" if at > _RIGHT - 12 else "middle"
        yield f'<path class="grid" d="M{at:.1f} {_TOP:g}V{_BOTTOM:g}"/>'
        yield (
            f'<text x="{at:.1f}" y="{_BOTTOM + 13:g}" text-anchor="{anchor}">{tick:g}{unit}</text>'
        )


def _path(line: ChartLine, x: _Place, y: _Place) -> str:
    curve = Curve(_MOST_POINTS)
    t, values = line.points
    curve.add(t, np.where(np.isfinite(values), values, np.nan)[:, None])
    drawn, pen = [], "M"
    for at, value in zip(*curve.line(0), strict=True):
        if math.isnan(value):
            pen = "M"
        else:
            drawn.append(f"{pen}{x(at):.1f} {y(value):.1f}")
            pen = "L"
    return f'<path class="{classes_of(line)}" d="{"".join(drawn)}"/>'


def classes_of(line: ChartLine) -> str:
    """Return the classes of a line, which say how it is drawn."""
    style = line_style(line.number)
    broken = f" run{line.run % 4}" if line.run else " broken" if style.is_broken else ""
    return f"l{style.color} {line.role}{broken}"
