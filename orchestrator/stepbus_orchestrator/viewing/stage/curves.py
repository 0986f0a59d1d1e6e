"""Curves of the signal that a viewer picks."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .signals import Signal

NOTHING = "(none)"
Data = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Times, shape (T,) [s], and values, shape (T, n)."""

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
        self._shown = NOTHING
        with tab:
            self._choice = self._gui.add_dropdown("signal", (NOTHING,), initial_value=NOTHING)
        self._choice.on_update(lambda _: self._choose())

    @property
    def signal(self) -> Signal | None:
        """Return the signal that is shown."""
        return self._signals.get(self._shown)

    def offer(self, found: Sequence[Signal]) -> None:
        """Offer signals to choose from; the first one is chosen where none is yet."""
        labels = {signal.label: signal for signal in found}
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
        data = (times, *values.T.copy())
        if self._chart is None:
            self._chart = self._make(signal, data)
        else:
            self._chart.data = data

    def _make(self, signal: Signal, data: tuple[Any, ...]) -> Any:
        lines = tuple(
            {"label": name, "stroke": _COLORS[number % len(_COLORS)], "width": 1.5}
            for number, name in enumerate(signal.names)
        )
        with self._tab:
            return self._gui.add_uplot(
                data=data,
                series=({"label": "t [s]"}, *lines),
                scales={"x": {"time": False}},
                legend={"show": True},
                aspect=1.4,
            )
