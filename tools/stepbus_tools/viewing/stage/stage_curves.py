"""The numbers in messages of any type, also of a user's own, as curves have them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_tools.viewing.scene import Messages

_MOST = 16
"""Curves of one signal; more cannot be told apart."""


@dataclass(frozen=True, kw_only=True)
class Signal:
    """A field of a port that has numbers. names: of its components."""

    topic: str
    field: str
    names: tuple[str, ...]

    @property
    def label(self) -> str:
        """Return its name, as `stepbus plot` has it."""
        return f"{self.topic.replace('/', '.', 1)}.{self.field}"


def signals(messages: Messages, names: dict[str, Sequence[str]]) -> list[Signal]:
    """Return the signals in the newest messages. names: of the vectors of each port."""
    curves = []
    for topic, latest in messages.items():
        for field in latest.message.__struct_fields__:
            values = numbers(getattr(latest.message, field))
            if values:
                own = tuple(names.get(topic, ()))
                shown = own if len(own) == len(values) else tuple(map(str, range(len(values))))
                curves.append(Signal(topic=topic, field=field, names=shown[:_MOST]))
    return curves


def numbers(value: object) -> list[float]:
    """Return a number, or a vector of them, as a list; nothing for anything else."""
    if isinstance(value, bool):
        return [float(value)]
    if isinstance(value, int | float):
        return [float(value)]
    if isinstance(value, list | tuple) and value and not isinstance(value[0], list | tuple | str):
        flat = [number for item in value[:_MOST] for number in numbers(item)]
        return flat if len(flat) == min(len(value), _MOST) else []
    return []


def value_of(signal: Signal, message: Any) -> list[float]:
    """Return the components of a signal in a message; NaN for what is absent."""
    values = numbers(getattr(message, signal.field, None))[: len(signal.names)]
    return values + [math.nan] * (len(signal.names) - len(values))


NOTHING = "(none)"
Data = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Times, shape (T,) [s], and values, shape (T, n). Times up to 0 count back from now."""

_COLORS = (
    "#1f77b4", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd", "#8c564b", "#e377c2", "#17becf",
    "#7f7f7f", "#bcbd22", "#3b5b92", "#b5338a", "#5a8f29", "#c7762b", "#6a3d9a", "#34495e",
)  # fmt: skip


class Curves:
    """A choice of signals and a chart, in a tab. sample: returns the data of a signal."""

    def __init__(self, server: Any, tab: Any, sample: Callable[[Signal], Data]) -> None:
        self._gui = server.gui
        self._tab = tab
        self._sample = sample
        self._signals: dict[str, Signal] = {}
        self._chart: Any = None
        self._span = (0.0, 0.0)
        self._shown = NOTHING
        with tab:
            self._choice = self._gui.add_dropdown("signal", (NOTHING,), initial_value=NOTHING)
        self._choice.on_update(lambda _: self._choose())

    @property
    def signal(self) -> Signal | None:
        """Return the signal that is shown."""
        return self._signals.get(self._shown)

    def offer(self, offered: Sequence[Signal]) -> None:
        """Offer signals to choose from; the first one is chosen where none is yet."""
        labels = {signal.label: signal for signal in offered}
        if labels.keys() <= self._signals.keys():
            return
        is_first = not self._signals
        self._signals |= labels
        self._choice.options = (NOTHING, *sorted(self._signals))
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
        """Draw the newest data."""
        signal = self.signal
        if signal is None:
            return
        times, values = self._sample(signal)
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
