"""The plots of joint control, beside the recording: report.png."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from stepbus_orchestrator.analysis.signals import (
    Array,
    Signal,
    Tracking,
    read_tracking,
    tracking_rmse,
)
from stepbus_orchestrator.analysis.sinusoid import sinusoid_lines
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import StepbusError

from .device_panels import Panel, device_panels
from .joint_panels import draw_panels

REPORT_FILE = "report.png"
_SETTLED_S = 2.0
_MOST_POINTS = 8000
# More joints than that share no plot.
_MOST_LINES = 6
_COLOURS = ("#1f77b4", "#d95f02", "#2ca02c", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f", "#17becf")


def write_report(path: Path) -> list[str]:
    """Plot a recording and return what a summary should say of it.

    path: the recording. The plots stand beside it as report.png. Returns nothing for a recording
    without joint states, and one line that says why for one that cannot be plotted.
    """
    try:
        recording = Recording.open(path)
        tracking = read_tracking(recording)
        if tracking.state is None:
            return []
        target = path.with_name(REPORT_FILE)
        _draw(_title(recording), tracking, device_panels(recording), target)
    except (StepbusError, OSError) as exc:
        return [f"no plots  {exc}"]
    return [*_summary(tracking), f"plots     {target}"]


def _title(recording: Recording) -> str:
    text = recording.attachments.get("scenario.yaml", b"").decode(errors="replace")
    names = [line.partition(":")[2] for line in text.splitlines() if line.startswith("name:")]
    return names[0].strip() if names else recording.path.stem


def _summary(tracking: Tracking) -> list[str]:
    state = tracking.state
    if state is None:
        return []
    settled = bool(state.t[-1] > _SETTLED_S)
    rmse = tracking_rmse(tracking, _SETTLED_S if settled else 0.0)
    if not rmse:
        return []
    when = f"after {_SETTLED_S:g} s" if settled else "of the whole run"
    lines = sinusoid_lines(tracking, _SETTLED_S if settled else 0.0)
    if len(rmse) > _MOST_LINES:
        worst = max(rmse, key=lambda joint: rmse[joint])
        return [*lines, f"tracking RMSE {when}: at most {rmse[worst]:.3g} rad ({worst})"]
    values = ", ".join(f"{joint} {value:.3g} rad" for joint, value in rmse.items())
    return [*lines, f"tracking RMSE {when}: {values}"]


def _draw(title: str, tracking: Tracking, devices: Sequence[Panel], target: Path) -> None:
    width = 26 if devices else 16
    figure = Figure(figsize=(width, 10), dpi=100 if not devices else 75, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=16)
    joints: Any = figure
    if devices:
        halves: Any = figure.subfigures(1, 2)
        joints = halves[0]
        _draw_devices(halves[1], devices)
    if tracking.state is not None and len(tracking.state.names) > _MOST_LINES:
        draw_panels(joints, tracking)
    else:
        _draw_four(joints, tracking)
    figure.savefig(target)


def _draw_devices(figure: Any, panels: Sequence[Panel]) -> None:
    """Plot what a mobile manipulator has beside its joints."""
    axes = figure.subplots(2, 2, squeeze=False).flatten()
    for axis, panel in zip(axes, panels, strict=False):
        panel(axis)
        axis.grid(visible=True, alpha=0.3)
    for axis in axes[len(panels) :]:
        axis.set_axis_off()


def _draw_four(figure: Any, tracking: Tracking) -> None:
    """Plot error, position, velocity and torque, all joints in each."""
    axes = figure.subplots(2, 2, sharex=True).flatten()
    for axis, panel in zip(axes, (_error, _trajectory, _velocity, _torque), strict=True):
        panel(axis, tracking)
        axis.grid(visible=True, alpha=0.3)
        axis.margins(x=0.01)
    for axis in axes[2:]:
        axis.set_xlabel("simulation time [s]")


def _error(axis: Any, tracking: Tracking) -> None:
    """Plot reference minus measured position; without a reference the targets of the motors."""
    axis.set_title("tracking error: reference − measured")
    axis.set_ylabel("error [rad]")
    state = tracking.state
    if state is None or not (tracking.joints or "target" in state.fields):
        _nothing(axis, "no joint reference in this recording")
        return
    axis.axhline(0.0, color="black", linewidth=0.8)
    if not tracking.joints:
        axis.set_title("error of the motors: target − measured")
    for place, joint in enumerate(tracking.joints or state.names):
        error = tracking.error(joint) if tracking.joints else _behind(state, joint)
        _line(axis, state.t, error, joint, place)
    _legend(axis)


def _behind(state: Signal, joint: str) -> Array:
    """Return target minus measured position of a joint, shape (m,) [rad]."""
    target, position = state.of("target", joint), state.of("position", joint)
    unknown = np.full(len(state.t), np.nan)
    return unknown if target is None or position is None else target - position


def _trajectory(axis: Any, tracking: Tracking) -> None:
    """Plot measured positions over the reference."""
    axis.set_title("position" + _against_what(tracking))
    axis.set_ylabel("position [rad]")
    _against(axis, tracking, "position", None)


def _velocity(axis: Any, tracking: Tracking) -> None:
    """Plot measured velocities over the reference; their finite difference where not sensed."""
    state = tracking.state
    sensed = state is not None and "velocity" in state.fields
    title = "velocity" + _against_what(tracking)
    axis.set_title(title + ("" if sensed else " (finite difference)"))
    axis.set_ylabel("velocity [rad/s]")
    _against(axis, tracking, "velocity", _difference)


def _against_what(tracking: Tracking) -> str:
    return "" if tracking.reference is None else " against reference"


def _difference(t: Array, position: Array) -> Array:
    slope: Array = np.gradient(position, t) if len(t) > 1 else np.zeros_like(position)
    return slope


def _against(
    axis: Any,
    tracking: Tracking,
    quantity: str,
    derive: Callable[[Array, Array], Array] | None,
) -> None:
    state, reference = tracking.state, tracking.reference
    if state is None:
        return
    for place, joint in enumerate(state.names):
        values = state.of(quantity, joint)
        position = state.of("position", joint)
        if values is None and derive is not None and position is not None:
            values = derive(state.t, position)
        if values is not None:
            _line(axis, state.t, values, joint, place)
        wanted = None if reference is None else reference.of(quantity, joint)
        if reference is not None and wanted is not None:
            _line(axis, reference.t, wanted, "reference" if place == 0 else "_", place, dashed=True)
    _legend(axis)


def _torque(axis: Any, tracking: Tracking) -> None:
    """Plot commanded torques and the limits they come near to."""
    axis.set_title("torque")
    axis.set_ylabel("torque [N·m]")
    signal, quantity = tracking.command, "values"
    if signal is None:
        signal, quantity = tracking.state, "effort"
    if signal is None or quantity not in signal.fields:
        _nothing(axis, "no torques in this recording")
        return
    largest = float(np.nanmax(np.abs(signal.fields[quantity])))
    for place, joint in enumerate(signal.names):
        values = signal.of(quantity, joint)
        if values is not None:
            _line(axis, signal.t, values, joint, place)
    for limit in sorted(set(_limits(tracking))):
        if np.isfinite(limit) and 0 < limit < 2.5 * largest:
            for sign in (-1, 1):
                axis.axhline(sign * limit, color="black", linestyle=":", linewidth=1)
    _legend(axis)


def _limits(tracking: Tracking) -> list[float]:
    signals = (tracking.command, tracking.state)
    return [limit for s in signals if s is not None for limit in s.limits.get("effort", [])]


def _line(
    axis: Any, t: Array, values: Array, label: str, place: int, *, dashed: bool = False
) -> None:
    t, values = _thinned(t, values)
    colour = _COLOURS[place % len(_COLOURS)]
    style = {"color": "black", "linestyle": (0, (4, 6)), "linewidth": 1.1, "zorder": 3}
    axis.plot(t, values, label=label, **(style if dashed else {"color": colour, "linewidth": 2}))


def _thinned(t: Array, values: Array) -> tuple[Array, Array]:
    """Return fewer points that look the same: the least and the largest of each bucket."""
    if len(t) <= _MOST_POINTS:
        return t, values
    size = -(-len(t) // (_MOST_POINTS // 2))
    starts = range(0, len(t), size)
    filled = np.where(np.isnan(values), 0.0, values)
    places = sorted(
        {
            start + int(pick(filled[start : start + size]))
            for start in starts
            for pick in (np.argmin, np.argmax)
        }
    )
    return t[places], values[places]


def _legend(axis: Any) -> None:
    if axis.get_legend_handles_labels()[0]:
        axis.legend(loc="best", fontsize=9)


def _nothing(axis: Any, text: str) -> None:
    axis.text(0.5, 0.5, text, transform=axis.transAxes, ha="center", color="grey")
