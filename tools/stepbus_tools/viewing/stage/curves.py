"""One signal as a chart of a page: what is chosen from, and how it is drawn."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_schemas import Message
from stepbus_tools.columns import NUMBERS, dotted, fields_of
from stepbus_tools.viewing.scene.bodies import Messages
from stepbus_tools.viewing.scene.build import Ports

_MOST = 16
"""Curves of one signal; more cannot be told apart."""
_NOTHING = "(none)"
Data = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Times, shape (T,) [s], and values, shape (T, n). Times up to 0 count back from now."""

_COLORS = (
    "#1f77b4", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd", "#8c564b", "#e377c2", "#17becf",
    "#7f7f7f", "#bcbd22", "#3b5b92", "#b5338a", "#5a8f29", "#c7762b", "#6a3d9a", "#34495e",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Signal:
    """A field of a port that has numbers. label: as `stepbus plot` has it. names: of its lines."""

    topic: str
    field: str
    names: Sequence[str]
    label: str = ""

    def values(self, message: Message) -> list[float]:
        """Return its numbers in a message; NaN for what is absent."""
        values = _numbers(getattr(message, self.field, None))[: len(self.names)]
        return values + [math.nan] * (len(self.names) - len(values))


def signals(ports: Ports, messages: Messages) -> list[Signal]:
    """Return what the newest messages of some ports have numbers of."""
    rows = []
    for topic, latest in messages.items():
        for field in fields_of(ports[topic], type(latest.message)):
            count = len(_numbers(getattr(latest.message, field.name)))
            if count and field.columns[0].type in (*NUMBERS, "list"):
                label, names = f"{dotted(ports[topic])}.{field.name}", field.labels(count)[:_MOST]
                rows.append(Signal(topic=topic, field=field.name, names=names, label=label))
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
    """A choice of signals and a chart, in a tab. sample: returns the data of a signal."""

    def __init__(self, server: Any, tab: Any, sample: Callable[[Signal], Data]) -> None:
        self._gui = server.gui
        self._tab = tab
        self._sample = sample
        self._signals: dict[str, Signal] = {}
        self._chart: Any = None
        self._shown = _NOTHING
        self._span = (0.0, 0.0)
        with tab:
            self._choice = self._gui.add_dropdown("signal", (_NOTHING,), initial_value=_NOTHING)
        self._choice.on_update(lambda _: self._choose())

    def offer(self, offered: Sequence[Signal]) -> None:
        """Offer signals to choose from; the first one is chosen where none is yet."""
        labels = {signal.label: signal for signal in offered}
        if labels.keys() <= self._signals.keys():
            return
        is_first = not self._signals
        self._signals |= labels
        self._choice.options = (_NOTHING, *sorted(self._signals))
        if is_first:
            self._choice.value = next(iter(labels))
            self._choose()

    def _choose(self) -> None:
        self._shown = self._choice.value
        if self._chart is not None:
            self._chart.remove()
            self._chart = None
        self.update()

    def update(self) -> None:
        """Draw the newest data of the signal that is chosen."""
        signal = self._signals.get(self._shown)
        if signal is None:
            return
        times, values = self._sample(signal)
        # The choice is made in a thread of viser's: a sample may be of the one before.
        if len(times) < 2 or values.shape[1] != len(signal.names):
            return
        data, span = (times, *values.T.copy()), _span(times)
        if self._chart is None:
            self._chart = self._make(signal, data, span)
        else:
            self._chart.data = data
            if span != self._span:
                self._chart.scales = _scales(span)
        self._span = span

    def _make(self, signal: Signal, data: tuple[Any, ...], span: tuple[float, float]) -> Any:
        lines = tuple(
            {"label": name, "stroke": _COLORS[number % len(_COLORS)], "width": 1.5}
            for number, name in enumerate(signal.names)
        )
        with self._tab:
            return self._gui.add_uplot(
                data=data,
                series=({"label": "t [s]" if span[1] else "before now [s]"}, *lines),
                scales=_scales(span),
                legend={"show": True},
                aspect=1.4,
            )


def _span(times: NDArray[np.float64]) -> tuple[float, float]:
    """Return the first and the last time of a chart; before now, it is one of a few sizes."""
    first, last = float(times[0]), float(times[-1])
    if last > 0:
        return first, last
    decade = 10.0 ** math.floor(math.log10(max(-first, 1e-3)))
    return -next(n * decade for n in (1, 2, 3, 4, 6, 8, 10) if n * decade >= -first - 1e-9), 0.0


def _scales(span: tuple[float, float]) -> dict[str, Any]:
    """Return scales with limits of our own.

    viser's page, left to find them, loses them for ever when it is so busy that new data comes
    before the chart is first drawn: the chart stays empty.
    """
    return {"x": {"time": False, "range": span}}
