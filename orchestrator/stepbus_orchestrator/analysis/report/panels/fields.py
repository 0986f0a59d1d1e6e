"""Plots of what no other panel shows: sensors, named numbers, and message types of one's own."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.report.curves.curve import Curve
from stepbus_orchestrator.analysis.signals import Array
from stepbus_orchestrator.recording import Batch, Port, Recording
from stepbus_schemas import json_schema

_SHOWN = ("Imu/1", "Scalars/1", "Wrench/1")
_MOST_PANELS = 8
_MOST_LINES = 8
_NUMBERS = "fiub"
"""Kinds of NumPy's types that can be plotted."""


class _Field:
    """The lines of one field of a port; none once its width changes."""

    def __init__(self, port: Port, name: str, unit: str) -> None:
        self.port = port
        self.name = name
        self.unit = port.units.get(name, unit)
        self.curve = Curve()
        self.width = 0

    def take(self, batch: Batch) -> None:
        """Take the next piece."""
        found = batch.arrays(self.name)[self.name]
        if found is None or not len(found) or found.dtype.kind not in _NUMBERS or self.width < 0:
            return
        values: Array = found.astype(np.float64).reshape(len(found), -1)
        if self.width not in (0, values.shape[1]):
            self.width = -1
            return
        self.width = values.shape[1]
        self.curve.add(batch.t, values[:, :_MOST_LINES])

    def labels(self) -> Sequence[str]:
        """Return the name of each line."""
        names = self.port.names
        each = range(self.width)
        return names if len(names) == self.width > 0 else [f"[{index}]" for index in each]


def field_panels(recording: Recording) -> list[Callable[[Any], None]]:
    """Return a panel for each field of numbers of such ports, up to eight."""
    wanted = (*_SHOWN, *recording.types.declarations)
    ports = [port for port in recording.ports.values() if port.type in wanted]
    fields = [
        _Field(port, name, node.get("unit", ""))
        for port in ports
        for name, node in json_schema(port.type, recording.types)["properties"].items()
    ]
    for piece in recording.batches(ports) if ports else ():
        for field in fields:
            field.take(piece[field.port.topic])
    plotted = [field for field in fields if field.width > 0]
    return [partial(_draw, field=field) for field in plotted[:_MOST_PANELS]]


def _draw(axis: Any, field: _Field) -> None:
    port, labels = field.port, field.labels()
    axis.set_title(f"{port.participant}.{port.name}: {field.name}")
    axis.set_xlabel("simulation time [s]")
    axis.set_ylabel(f"{field.name} [{field.unit}]" if field.unit else field.name)
    for index, label in enumerate(labels[:_MOST_LINES]):
        axis.plot(*field.curve.line(index), linewidth=1.5, label=label if field.width > 1 else None)
    if field.width > 1:
        axis.legend(loc="best", fontsize=9)
