"""Small curves as SVG: they are there without a script, on paper and in a preview."""

import math
from collections.abc import Callable, Iterator, Sequence
from html import escape

import numpy as np

from stepbus_tools.look import line_style
from stepbus_tools.report.charts import Chart, ChartLine, Mark
from stepbus_tools.report.curves import Curve
from stepbus_tools.report.units import prefixed

_WIDTH, _HEIGHT = 300.0, 118.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 42.0, 296.0, 8.0, 100.0
_MOST_POINTS = 240
_ROOM = 0.06
_MOST_DIGITS, _LARGE = 5, 1e6
_SAID = ("failure", "fault")
_MOST_SAID = 3
_Place = Callable[[float], float]
_Parts = Iterator[str]


def small_chart(chart: Chart, marks: Sequence[Mark], end_s: float) -> str:
    """Return a chart as a picture. end_s: where its time axis ends [s]."""
    low, high = _range(chart)
    factor, unit = scale_of(chart)

    def x(t: float) -> float:
        return _LEFT + (_RIGHT - _LEFT) * t / (end_s or 1.0)

    def y(value: float) -> float:
        return _BOTTOM - (_BOTTOM - _TOP) * (value - low) / (high - low)

    parts = [*_grid((low, high), factor, end_s, x, y)]
    parts += [
        f'<path class="limit" d="M{_LEFT:g} {y(limit):.1f}H{_RIGHT:g}"/>'
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
        f'viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}">{"".join(parts)}</svg>'
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
    if not (math.isfinite(span) and span > 0):
        return [low]
    size = 10 ** math.floor(math.log10(span / most))
    step = next(size * k for k in (1, 2, 5, 10, 20) if span / (size * k) <= most)
    first = math.ceil(low / step - 1e-9)
    return [step * n for n in range(first, math.floor(high / step + 1e-9) + 1)]


def labels_of(ticks: Sequence[float]) -> list[str]:
    """Return ticks as texts, with as many digits as tell them apart."""
    step = ticks[1] - ticks[0] if len(ticks) > 1 else abs(ticks[0]) or 1.0
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    if digits > _MOST_DIGITS or max(map(abs, ticks)) >= _LARGE:
        return [f"{tick:.3g}" for tick in ticks]
    return [f"{tick + 0.0:.{digits}f}" for tick in ticks]


def _grid(ends: tuple[float, float], factor: float, end_s: float, x: _Place, y: _Place) -> _Parts:
    rows = nice_ticks(ends[0] * factor, ends[1] * factor, 4)
    for tick, label in zip(rows, labels_of(rows), strict=True):
        at = y(tick / factor)
        yield f'<path class="grid" d="M{_LEFT:g} {at:.1f}H{_RIGHT:g}"/>'
        yield f'<text x="{_LEFT - 4:g}" y="{at + 3:.1f}" text-anchor="end">{label}</text>'
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
    style = line_style(line.number)
    broken = f" run{line.run % 4}" if line.run else " broken" if style.is_broken else ""
    return f'<path class="l{style.color} {line.role}{broken}" d="{"".join(drawn)}"/>'
