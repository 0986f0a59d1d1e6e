"""The classic plots of joint control: error, position, velocity and torque, all joints in each."""

from typing import Any

import numpy as np

from .style import legend, line, write_instead
from .tracking_curves import TrackingCurves


def draw_tracking(figure: Any, tracking: TrackingCurves) -> None:
    """Plot error, position, velocity and torque, all joints in each."""
    axes = figure.subplots(2, 2, sharex=True).flatten()
    for axis, panel in zip(axes, (draw_error, _trajectory, _velocity, _torque), strict=True):
        panel(axis, tracking)
        axis.grid(visible=True, alpha=0.3)
        axis.margins(x=0.01)
    for axis in axes[2:]:
        axis.set_xlabel("simulation time [s]")


def draw_error(axis: Any, tracking: TrackingCurves) -> None:
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
        line(axis, tracking.error(joint), joint, index)
    legend(axis)


def _trajectory(axis: Any, tracking: TrackingCurves) -> None:
    """Plot measured positions over the reference."""
    axis.set_title("position" + _against_what(tracking))
    axis.set_ylabel("position [rad]")
    _against(axis, tracking, "position")


def _velocity(axis: Any, tracking: TrackingCurves) -> None:
    """Plot measured velocities over the reference; their finite difference where not sensed."""
    state = tracking.state
    sensed = state is not None and "velocity" in state.fields
    title = "velocity" + _against_what(tracking)
    axis.set_title(title + ("" if sensed else " (finite difference)"))
    axis.set_ylabel("velocity [rad/s]")
    _against(axis, tracking, "velocity")


def _against_what(tracking: TrackingCurves) -> str:
    return "" if tracking.reference is None else " against reference"


def _against(axis: Any, tracking: TrackingCurves, quantity: str) -> None:
    state, reference = tracking.state, tracking.reference
    if state is None:
        return
    for index, joint in enumerate(state.names):
        measured = state.of(quantity, joint)
        if measured is None and quantity == "velocity":
            measured = state.slope(joint)
        if measured is not None:
            line(axis, measured, joint, index)
        wanted = None if reference is None else reference.of(quantity, joint)
        if wanted is not None:
            line(axis, wanted, "reference" if index == 0 else "_", index, dashed=True)
    legend(axis)


def _torque(axis: Any, tracking: TrackingCurves) -> None:
    """Plot commanded torques and the limits they come near to."""
    axis.set_title("torque")
    axis.set_ylabel("torque [N·m]")
    signal, quantity = tracking.command, "values"
    if signal is None:
        signal, quantity = tracking.state, "effort"
    if signal is None or quantity not in signal.fields:
        write_instead(axis, "no torques in this recording")
        return
    largest = signal.largest(quantity)
    for index, joint in enumerate(signal.names):
        values = signal.of(quantity, joint)
        if values is not None:
            line(axis, values, joint, index)
    for limit in sorted(set(_limits(tracking))):
        if np.isfinite(limit) and 0 < limit < 2.5 * largest:
            for sign in (-1, 1):
                axis.axhline(sign * limit, color="black", linestyle=":", linewidth=1)
    legend(axis)


def _limits(tracking: TrackingCurves) -> list[float]:
    signals = (tracking.command, tracking.state)
    return [limit for s in signals if s is not None for limit in s.limits.get("effort", [])]
