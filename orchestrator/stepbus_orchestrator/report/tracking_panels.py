"""The classic plots of joint control: error, position, velocity and torque, all joints in each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.signals import Array, Signal, Tracking

from .style import legend, line, write_instead


def draw_tracking(figure: Any, tracking: Tracking) -> None:
    """Plot error, position, velocity and torque, all joints in each."""
    axes = figure.subplots(2, 2, sharex=True).flatten()
    for axis, panel in zip(axes, (draw_error, _trajectory, _velocity, _torque), strict=True):
        panel(axis, tracking)
        axis.grid(visible=True, alpha=0.3)
        axis.margins(x=0.01)
    for axis in axes[2:]:
        axis.set_xlabel("simulation time [s]")


def draw_error(axis: Any, tracking: Tracking) -> None:
    """Plot reference minus measured position; without a reference the targets of the motors."""
    axis.set_title("tracking error: reference − measured")
    axis.set_ylabel("error [rad]")
    state = tracking.state
    if state is None or not (tracking.joints or "target" in state.fields):
        write_instead(axis, "no joint reference in this recording")
        return
    axis.axhline(0.0, color="black", linewidth=0.8)
    if not tracking.joints:
        axis.set_title("error of the motors: target − measured")
    for index, joint in enumerate(tracking.joints or state.names):
        error = tracking.error(joint) if tracking.joints else _behind(state, joint)
        line(axis, state.t, error, joint, index)
    legend(axis)


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
    for index, joint in enumerate(state.names):
        values = state.of(quantity, joint)
        position = state.of("position", joint)
        if values is None and derive is not None and position is not None:
            values = derive(state.t, position)
        if values is not None:
            line(axis, state.t, values, joint, index)
        wanted = None if reference is None else reference.of(quantity, joint)
        if reference is not None and wanted is not None:
            line(axis, reference.t, wanted, "reference" if index == 0 else "_", index, dashed=True)
    legend(axis)


def _torque(axis: Any, tracking: Tracking) -> None:
    """Plot commanded torques and the limits they come near to."""
    axis.set_title("torque")
    axis.set_ylabel("torque [N·m]")
    signal, quantity = tracking.command, "values"
    if signal is None:
        signal, quantity = tracking.state, "effort"
    if signal is None or quantity not in signal.fields:
        write_instead(axis, "no torques in this recording")
        return
    largest = float(np.nanmax(np.abs(signal.fields[quantity])))
    for index, joint in enumerate(signal.names):
        values = signal.of(quantity, joint)
        if values is not None:
            line(axis, signal.t, values, joint, index)
    for limit in sorted(set(_limits(tracking))):
        if np.isfinite(limit) and 0 < limit < 2.5 * largest:
            for sign in (-1, 1):
                axis.axhline(sign * limit, color="black", linestyle=":", linewidth=1)
    legend(axis)


def _limits(tracking: Tracking) -> list[float]:
    signals = (tracking.command, tracking.state)
    return [limit for s in signals if s is not None for limit in s.limits.get("effort", [])]
