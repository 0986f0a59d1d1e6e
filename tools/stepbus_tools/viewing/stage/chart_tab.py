"""Signals as charts of a page: a tree of ports to choose from, and how they are drawn."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_schemas import Message
from stepbus_tools.columns import dotted, fields_of, limits_of
from stepbus_tools.report.charts import Mark
from stepbus_tools.theme import LINES, PAPER, line_style
from stepbus_tools.viewing.scene.build import Ports
from stepbus_tools.viewing.scene.scene import Messages

_MOST_LINES = 16
"""Of one signal; more cannot be told apart."""
_MOST_CHARTS = 8
_LAST = 1000.0
"""Order of what comes after all charts."""
Data = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Times, shape (T,) [s], and values, shape (T, n). Times up to 0 count back from now.

A second recording has its values after those of the first, shape (T, 2 n).
"""
_FAILURE, _PAST = "failure", 0.02
"""The end of a run that failed is a line, which the axis goes past by so much of its length."""
_RULES = (
    ("soft", ("info", "warning", "goal", "call")),
    ("bad", ("error", "fault", "failure")),
    ("line", ("divergence",)),
)
"""Lines up and down: their colour, and the levels of what they mark."""
_RULE_COLORS = {"soft": f"{PAPER['soft']}70", "bad": PAPER["bad"], "line": LINES[1]}
_UNNAMED, _BROKEN, _THIN = "\u2060", "\u2061", "\u2062"
"""Begin the label of a line that is left out of the legend, or drawn so in it (front.js)."""
_PALE = "73"
"""Of a second recording: its lines are a halo of those that they coincide with."""


@dataclass(frozen=True, kw_only=True)
class Signal:
    """A field of a port that has numbers. label: as `stepbus plot` has it. names: of its lines.

    limits: of each line, the lower and the upper one; infinite where there is none.
    """

    topic: str
    field: str
    names: Sequence[str]
    label: str = ""
    unit: str = ""
    limits: Sequence[tuple[float, float]] = ()

    def values(self, message: Message) -> list[float]:
        """Return its numbers in a message; NaN where absent."""
        values = _numbers(getattr(message, self.field, None))[: len(self.names)]
        return values + [math.nan] * (len(self.names) - len(values))

    @property
    def key(self) -> tuple[str, str]:
        """Return (topic, field), which identifies the signal."""
        return self.topic, self.field

    @property
    def title(self) -> str:
        """Return its label with its unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


def signals(ports: Ports, messages: Messages) -> list[Signal]:
    """Return the signals of messages: all fields with numbers."""
    rows = []
    for topic, latest in messages.items():
        port = ports[topic]
        for field in fields_of(port, type(latest.message)):
            count = len(_numbers(getattr(latest.message, field.name)))
            if count and field.is_numeric:
                label, names = f"{dotted(port)}.{field.name}", field.labels(count)[:_MOST_LINES]
                described = port.description.limits
                limits = [limits_of(described, field.name, index) for index in range(len(names))]
                unit = field.columns[0].unit
                rows.append(
                    Signal(
                        topic=topic,
                        field=field.name,
                        names=names,
                        label=label,
                        unit=unit,
                        limits=limits if np.isfinite(limits).any() else (),
                    )
                )
    return rows


def _numbers(value: Any) -> list[float]:
    """Return a number, or a vector of them, as a list; nothing for anything else."""
    try:
        numbers: list[float] = (
            np.array(() if value is None else value, dtype=float).ravel().tolist()
        )
    except (ValueError, TypeError):
        return []
    return numbers


class Curves:
    """A tree of ports and the charts of the signals that are chosen in it, in a tab.

    gui: of a server of viser. sample: returns the data of a signal. runs:
    names of two recordings whose values it has, else none.
    """

    def __init__(
        self, gui: Any, tab: Any, sample: Callable[[Signal], Data], runs: Sequence[str] = ()
    ) -> None:
        self._gui = gui
        self._tab = tab
        self._sample = sample
        self._runs = runs
        self._signals: dict[str, Signal] = {}
        self._boxes: dict[str, Any] = {}
        self._folders: dict[str, Any] = {}
        self._charts: dict[str, _Chart] = {}
        with tab:
            self._hint = gui.add_markdown("choose signals below", order=_LAST - 1)

    def offer(self, offered: Sequence[Signal]) -> None:
        """Offer signals to choose from; the first is chosen if there was none."""
        for signal in offered:
            if signal.label not in self._signals:
                is_first = not self._signals
                self._signals[signal.label] = signal
                with self._folder(signal, is_first):
                    what = signal.title.removeprefix(".".join(signal.label.split(".")[:-1]) + ".")
                    box = self._gui.add_checkbox(what, initial_value=is_first, hint=signal.title)
                self._boxes[signal.label] = box

    def _folder(self, signal: Signal, is_open: bool) -> Any:
        """Return the folder of a signal's port, in that of its participant."""
        participant, port, *_ = signal.label.split(".")
        parent, path = self._tab, ""
        for name in (participant, port):
            path += f".{name}"
            if path not in self._folders:
                with parent:
                    order = {"order": _LAST} if parent is self._tab else {}
                    self._folders[path] = self._gui.add_folder(
                        name, expand_by_default=is_open, **order
                    )
            parent = self._folders[path]
        return parent

    def update(self, marks: Sequence[Mark] = (), now_s: float | None = None) -> None:
        """Draw the newest data of the signals that are chosen, with marks, and a line at now."""
        chosen = [label for label, box in self._boxes.items() if box.value][:_MOST_CHARTS]
        if self._hint.visible != (not chosen):
            self._hint.visible = not chosen
        for label in [label for label in self._charts if label not in chosen]:
            self._charts.pop(label).remove()
        for label in chosen:
            if label not in self._charts:
                self._charts[label] = _Chart(self._gui, self._tab, self._signals[label], self._runs)
            chart = self._charts[label]
            chart.draw(self._sample(chart.signal), marks, now_s)


class _Chart:
    """The chart of one signal."""

    def __init__(self, gui: Any, tab: Any, signal: Signal, runs: Sequence[str]) -> None:
        self.signal = signal
        self._gui = gui
        self._tab = tab
        self._runs = runs
        self._plot: Any = None
        self._scales: dict[str, Any] = {}
        self._drawn: tuple[Any, ...] = ()

    def remove(self) -> None:
        """Take it off the page."""
        if self._plot is not None:
            self._plot.remove()

    def draw(self, data: Data, marks: Sequence[Mark], now_s: float | None) -> None:
        """Draw data, marks, and a line at now."""
        times, values = data
        drawn = (len(times), *times[-1:], len(marks), now_s, *values[-1:].ravel())
        if len(times) < 2 or drawn == self._drawn:
            return
        self._drawn = drawn
        low, high = value_span(values, self.signal.limits)
        x, rows = _rows(data, self.signal.limits, marks, now_s, (low, high))
        span = time_span(times)
        if any(mark.level == _FAILURE for mark in marks):
            span = span[0], span[1] + _PAST * (span[1] - span[0])
        # viser's page, left to find limits, loses them for ever when it is so busy that new data
        # comes before the chart is first drawn: the chart stays empty.
        scales = {
            "x": {"time": False, "range": span},
            "y": {"auto": False, "range": (low, high)},
        }
        if self._plot is None:
            self._plot = self._make((x, *rows), span[1] > 0, scales)
        else:
            self._plot.data = (x, *rows)
            if scales != self._scales:
                self._plot.scales = scales
        self._scales = scales

    def _make(self, data: tuple[Any, ...], is_past: bool, scales: Mapping[str, Any]) -> Any:
        axis = {"stroke": PAPER["soft"], "grid": {"stroke": PAPER["line"], "width": 1}}
        with self._tab:
            return self._gui.add_uplot(
                data=data,
                title=self.signal.title,
                series=({"label": "t [s]" if is_past else "before now [s]"}, *self._series()),
                scales=scales,
                axes=(axis, axis | {"size": 56}),
                legend={"show": True},
                aspect=1.6,
                padding=(8, 12, 0, 0),
            )

    def _series(self) -> list[dict[str, Any]]:
        names = self.signal.names
        lines = [
            _curve(number, name, run, is_ghost=bool(place))
            for place, run in enumerate(self._runs or ("",))
            for number, name in enumerate(names)
        ]
        for number in range(len(self.signal.limits)):
            color = LINES[line_style(number).color]
            for end in ("lower", "upper"):
                label = f"{end} limit of {names[number]}"
                lines.append(_rule(label, color, dash=(2, 4)))
        for name, _ in _RULES:
            lines.append(_rule(name, _RULE_COLORS[name], dash=(6, 3)))
        return [*lines, _rule("now", PAPER["ink"], width=2)]


def _curve(number: int, name: str, run: str, *, is_ghost: bool) -> dict[str, Any]:
    """Return how a line is drawn. run: of two, which are told by the line's style; else empty."""
    style = line_style(number)
    is_broken, is_thin = (is_ghost, style.is_broken) if run else (style.is_broken, False)
    mark = _BROKEN * is_broken + _THIN * is_thin
    line = {
        "label": f"{mark}{name} · {run}" if run else f"{mark}{name}",
        "stroke": LINES[style.color] + _PALE * is_ghost,
        "width": (4 if is_ghost else 2) / (2 if is_thin else 1) if run else 1.5,
    }
    return line | ({"dash": (5, 4)} if is_broken else {})


def _rule(label: str, color: str, **more: Any) -> dict[str, Any]:
    return {"label": _UNNAMED + label, "stroke": color, "width": 1} | more


def _rows(
    data: Data,
    limits: Sequence[tuple[float, float]],
    marks: Sequence[Mark],
    now_s: float | None,
    span: tuple[float, float],
) -> tuple[Any, list[Any]]:
    """Return times, and what is drawn over them: values, limits, marks, and now.

    A line up and down is three points at the same time, from below the chart and back.
    """
    times, values = data
    # A failure may be of the step after the last whole one.
    ends_s = {id(mark): min(mark.t, times[-1]) for mark in marks if mark.level == _FAILURE}
    kinds = [
        [ends_s.get(id(mark), mark.t) for mark in marks if mark.level in levels]
        for _, levels in _RULES
    ]
    kinds.append([] if now_s is None else [now_s])
    kinds = [[t for t in kind if times[0] <= t <= times[-1]] for kind in kinds]
    size = span[1] - span[0]
    below, above = span[0] - size, span[1] + size
    x = np.concatenate([times, *(np.repeat(kind, 3) for kind in kinds)])
    order = np.argsort(x, kind="stable")
    x = x[order]
    # A line without a value leaves the chart downwards: NaN would take its axes away.
    rows = [np.interp(x, times, np.where(np.isfinite(row), row, below)) for row in values.T]
    ends = (end if math.isfinite(end) else below for pair in limits for end in pair)
    rows += [np.full(len(x), end) for end in ends]
    start = len(times)
    for kind in kinds:
        comb = np.full(len(x), below)
        comb[start + 1 : start + 3 * len(kind) : 3] = above
        start += 3 * len(kind)
        rows.append(comb[order])
    return x, rows


def time_span(times: NDArray[np.float64]) -> tuple[float, float]:
    """Return the ends of a time axis [s]; before now, it has one of a few lengths."""
    first, last = float(times[0]), float(times[-1])
    if last > 0:
        return first, last
    return -_rounded(max(-first, 1e-3)), 0.0


def value_span(
    values: NDArray[np.float64], limits: Sequence[tuple[float, float]] = ()
) -> tuple[float, float]:
    """Return the ends of a chart: of all values and of limits near them. They seldom change."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    reach = high - low or max(abs(high), 1.0) * 0.1
    near = [end for pair in limits for end in pair if low - reach / 4 <= end <= high + reach / 4]
    low, high = min([low, *near]), max([high, *near])
    step = _rounded((high - low or reach) / 8)
    return math.floor(low / step - 0.25) * step, math.ceil(high / step + 0.25) * step


def _rounded(size: float) -> float:
    """Return the next larger of a few sizes."""
    decade = 10.0 ** math.floor(math.log10(size))
    return float(next(n * decade for n in (1, 2, 3, 4, 6, 8, 10) if n * decade >= size - 1e-9))
