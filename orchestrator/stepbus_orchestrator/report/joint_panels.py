"""Plots of many joints: one panel each, measured over target, in degrees."""

from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.signals import Array

from .curve import Line
from .tracking_curves import SignalCurves, TrackingCurves

# Less than this is noise, not motion [°, mm].
_LEAST_SPAN = 1.0
_COLUMNS = 4
_MEASURED = {"color": "#1f77b4", "linewidth": 2.0}
_TARGET = {"color": "#d95f02", "linewidth": 1.4, "linestyle": (0, (4, 3))}


def draw_panels(figure: Any, tracking: TrackingCurves) -> None:
    """Draw one panel per measured joint; angles in degrees, prismatic joints in millimetres.

    figure: of matplotlib, with a constrained layout. Lines that mean the same have one colour.
    """
    state = tracking.state
    if state is None:
        return
    rows = -(-len(state.names) // _COLUMNS)
    axes = figure.subplots(rows, _COLUMNS, sharex=True, squeeze=False)
    for axis, joint in zip(axes.flatten(), state.names, strict=False):
        _panel(axis, tracking, state, joint)
    for axis in axes.flatten()[len(state.names) :]:
        axis.set_axis_off()
    for axis in axes.flatten()[: len(state.names)][-_COLUMNS:]:
        axis.set_xlabel("simulation time [s]")
        axis.tick_params(labelbottom=True)
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower right", ncols=len(labels), fontsize=12)


def _panel(axis: Any, tracking: TrackingCurves, state: SignalCurves, joint: str) -> None:
    scale, unit = _unit(state, joint)
    axis.set_title(joint)
    axis.set_ylabel(f"[{unit}]")
    axis.grid(visible=True, alpha=0.3)
    axis.margins(x=0.01)
    rows = (
        (state.of("position", joint), {"label": "measured", **_MEASURED}),
        (_target_of(tracking, state, joint), {"label": "target", **_TARGET}),
    )
    shown: list[Array] = []
    for points, style in rows:
        if points is not None:
            t, values = points
            shown.append(scale * values)
            axis.plot(t, shown[-1], **style)
    _widen(axis, shown)


def _target_of(tracking: TrackingCurves, state: SignalCurves, joint: str) -> Line | None:
    """Return a joint's target: its reference, or else its position target."""
    if tracking.reference is not None and joint in tracking.reference.names:
        return tracking.reference.of("position", joint)
    return state.of("target", joint)


def _unit(state: SignalCurves, joint: str) -> tuple[float, str]:
    is_prismatic = state.joint_types.get(joint) == "prismatic"
    return (1e3, "mm") if is_prismatic else (float(np.degrees(1.0)), "°")


def _widen(axis: Any, shown: list[Array]) -> None:
    """Show noise as small as it is."""
    values = np.concatenate([row[np.isfinite(row)] for row in shown]) if shown else np.array([])
    if values.size and np.ptp(values) < _LEAST_SPAN:
        middle = float(values.min() + values.max()) / 2
        axis.set_ylim(middle - _LEAST_SPAN / 2, middle + _LEAST_SPAN / 2)
        axis.ticklabel_format(useOffset=False)
