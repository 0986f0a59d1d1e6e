"""The panels of a picture: what is drawn into each."""

from collections.abc import Iterator, Sequence

import numpy as np

from stepbus_orchestrator.analysis.signals import Array
from stepbus_orchestrator.recording import Batch, Port, Recording
from stepbus_schemas import json_schema
from stepbus_tools.report.curves import Curve, Line, TrackingCurves
from stepbus_tools.report.signals_plot import MOST_LINES, Panel

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
        column = batch.arrays(self.name)[self.name]
        if column is None or not len(column) or column.dtype.kind not in _NUMBERS or self.width < 0:
            return
        values: Array = column.astype(np.float64).reshape(len(column), -1)
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


def joint_panels(tracking: TrackingCurves) -> list[Panel]:
    """Return a panel for each quantity that there is; joints that slide have panels of their own.

    Measured values are drawn over references, torques over commands. Of more than twenty joints,
    the first are shown.
    """
    panels: list[Panel] = []
    for is_sliding, length, force in (
        (False, "rad", ("torque", "N·m")),
        (True, "m", ("force", "N")),
    ):
        joints = [name for name in tracking.measured if tracking.is_prismatic(name) == is_sliding]
        more = f" (first {MOST_LINES} of {len(joints)} joints)" if len(joints) > MOST_LINES else ""
        shown = joints[:MOST_LINES]
        panels += [
            _errors(tracking, shown, length, more),
            _motion(tracking, shown, "position", length, more),
            _motion(tracking, shown, "velocity", f"{length}/s", more),
            _efforts(tracking, shown, *force, more),
        ]
    return [panel for panel in panels if panel.lines]


def _errors(tracking: TrackingCurves, joints: Sequence[str], unit: str, more: str) -> Panel:
    """Return reference minus measured position; without a reference, the targets of the motors."""
    what = "reference" if tracking.joints else "target"
    known = tracking.joints or (tracking.measured if tracking.has_targets else ())
    lines = {joint: tracking.error(joint) for joint in joints if joint in known}
    return Panel(title=f"error: {what} − measured{more}", unit=unit, lines=lines)


def _motion(
    tracking: TrackingCurves, joints: Sequence[str], quantity: str, unit: str, more: str
) -> Panel:
    """Return measured positions, or velocities, over the reference."""
    panel = Panel(title=f"{quantity}{more}", unit=unit)
    for joint in joints:
        state, reference = tracking.state_of(joint), tracking.reference_of(joint)
        measured = None if state is None else state.of(quantity, joint)
        if measured is None and state is not None and quantity == "velocity":
            # Where it is not sensed, it is the finite difference of positions.
            measured = state.slope(joint)
        wanted = None if reference is None else reference.of(quantity, joint)
        _put(panel, joint, measured, wanted, "reference")
    return panel


def _efforts(
    tracking: TrackingCurves, joints: Sequence[str], what: str, unit: str, more: str
) -> Panel:
    """Return measured efforts over the commands; where none is measured, the commands."""
    panel = Panel(title=f"{what}{more}", unit=unit)
    for joint in joints:
        state = tracking.state_of(joint)
        measured = None if state is None else state.of("effort", joint)
        commanded = next(_commands(tracking, joint), None)
        if measured is None:
            measured, commanded = commanded, None
        _put(panel, joint, measured, commanded, "commanded")
    return panel


def _commands(tracking: TrackingCurves, joint: str) -> Iterator[Line]:
    for port in tracking.torques:
        if (line := port.of("values", joint)) is not None:
            yield line


def _put(panel: Panel, joint: str, measured: Line | None, wanted: Line | None, name: str) -> None:
    """Add the lines of a joint; the legend names what is dashed once."""
    if measured is not None:
        panel.lines[joint] = measured
    if wanted is not None:
        panel.dashed[f"_{joint}" if panel.dashed else name] = wanted
