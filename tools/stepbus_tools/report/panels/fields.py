"""Curves of what is no joint: base, gripper, sensors, named numbers, types of one's own."""

from collections.abc import Sequence

import numpy as np

from stepbus_orchestrator.recording import Batch, Port, Recording
from stepbus_orchestrator.toolkit import Array
from stepbus_schemas import json_schema
from stepbus_tools.report.curves.curve import Curve
from stepbus_tools.report.signals_plot import Panel

_SHOWN = ("BaseState/1", "GripperState/1", "Imu/1", "Scalars/1", "Wrench/1")
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
        if self.width == 1:
            return [self.name]
        names = self.port.names
        each = range(self.width)
        return names if len(names) == self.width > 0 else [f"[{index}]" for index in each]


def field_panels(recording: Recording) -> list[Panel]:
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
    return [_panel(field) for field in plotted[:_MOST_PANELS]]


def _panel(field: _Field) -> Panel:
    port, labels = field.port, field.labels()[:_MOST_LINES]
    return Panel(
        title=f"{port.participant}.{port.name}: {field.name}",
        unit=field.unit,
        lines={label: field.curve.line(index) for index, label in enumerate(labels)},
    )
