"""Plots of many joints: one panel each, measured over target, in degrees or m."""

from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.signals import Array

from .curve import Line
from .tracking_curves import SignalCurves, TrackingCurves

# Less than this is noise, not motion.
_LEAST_SPAN = 1.0
"""[°]"""
_LEAST_SPAN_M = 1e-3
"""[m]"""
_COLUMNS = 4
_MEASURED = {"color": "#1f77b4", "linewidth": 2.0}
_TARGET = {"color": "#d95f02", "linewidth": 1.4, "linestyle": (0, (4, 3))}


def draw_panels(figure: Any, tracking: TrackingCurves) -> None:
    """Draw one panel per measured joint; angles in degrees, prismatic joints in m.

    figure: of matplotlib, with a constrained layout. Lines that mean the same have one colour.
    """
    joints = tracking.measured
    if not joints:
        return
    axes = figure.subplots(panel_rows(tracking), _COLUMNS, sharex=True, squeeze=False)
    for axis, joint in zip(axes.flatten(), joints, strict=False):
        state = tracking.state_of(joint)
        if state is not None:
            _panel(axis, tracking, state, joint)
    for axis in axes.flatten()[len(joints) :]:
        axis.set_axis_off()
    for axis in axes.flatten()[: len(joints)][-_COLUMNS:]:
        axis.set_xlabel("simulation time [s]")
        axis.tick_params(labelbottom=True)
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower right", ncols=len(labels), fontsize=12)


def panel_rows(tracking: TrackingCurves) -> int:
    """Return how many rows of panels there are."""
    return -(-len(tracking.measured) // _COLUMNS)


def _panel(axis: Any, tracking: TrackingCurves, state: SignalCurves, joint: str) -> None:
    is_prismatic = tracking.is_prismatic(joint)
    scale, unit = (1.0, "m") if is_prismatic else (float(np.degrees(1.0)), "°")
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
    _widen(axis, shown, _LEAST_SPAN_M if is_prismatic else _LEAST_SPAN)


def _target_of(tracking: TrackingCurves, state: SignalCurves, joint: str) -> Line | None:
    """Return a joint's target: its reference, or else its position target."""
    reference = tracking.reference_of(joint)
    if reference is not None:
        return reference.of("position", joint)
    return state.of("target", joint)


def _widen(axis: Any, shown: list[Array], least: float) -> None:
    """Show noise as small as it is."""
    values = np.concatenate([row[np.isfinite(row)] for row in shown]) if shown else np.array([])
    if values.size and np.ptp(values) < least:
        middle = float(values.min() + values.max()) / 2
        axis.set_ylim(middle - least / 2, middle + least / 2)
        axis.ticklabel_format(useOffset=False)
