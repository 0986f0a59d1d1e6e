"""The classic plots of joint control: error, position, velocity and torque, all joints in each."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.report.curves.curve import Line
from stepbus_orchestrator.analysis.report.curves.tracking import SignalCurves, TrackingCurves

from .style import colour, legend, line, write_instead

_NEAR = 2.5
"""Times the largest torque up to which limits are drawn."""


def draw_tracking(figure: Any, tracking: TrackingCurves) -> None:
    """Plot error, position, velocity and torque, all joints in each."""
    axes = figure.subplots(2, 2, sharex=True).flatten()
    for axis, panel in zip(axes, (draw_error, _trajectory, _velocity, draw_torque), strict=True):
        panel(axis, tracking)
        axis.grid(visible=True, alpha=0.3)
        axis.margins(x=0.01)
    for axis in axes[2:]:
        axis.set_xlabel("simulation time [s]")


def draw_error(axis: Any, tracking: TrackingCurves) -> None:
    """Plot reference minus measured position; without a reference the targets of the motors."""
    axis.set_title("tracking error: reference − measured")
    joints = tracking.joints or tracking.measured
    axis.set_ylabel(f"error {_unit(tracking, joints, 'rad', 'm')}")
    if not (tracking.joints or tracking.has_targets):
        write_instead(axis, "no joint reference in this recording")
        return
    axis.axhline(0.0, color="black", linewidth=0.8)
    if not tracking.joints:
        axis.set_title("error of the motors: target − measured")
    for index, joint in enumerate(joints):
        line(axis, tracking.error(joint), _label(tracking, joint, joints, "m"), index)
    legend(axis)


def _trajectory(axis: Any, tracking: TrackingCurves) -> None:
    """Plot measured positions over the reference."""
    axis.set_title("position" + _against_what(tracking))
    axis.set_ylabel(f"position {_unit(tracking, tracking.measured, 'rad', 'm')}")
    _against(axis, tracking, "position", "m")


def _velocity(axis: Any, tracking: TrackingCurves) -> None:
    """Plot measured velocities over the reference; their finite difference where not sensed."""
    states = [tracking.state_of(joint) for joint in tracking.measured]
    sensed = all(state is not None and "velocity" in state.fields for state in states)
    title = "velocity" + _against_what(tracking)
    axis.set_title(title + ("" if sensed else " (finite difference)"))
    axis.set_ylabel(f"velocity {_unit(tracking, tracking.measured, 'rad/s', 'm/s')}")
    _against(axis, tracking, "velocity", "m/s")


def _against_what(tracking: TrackingCurves) -> str:
    return " against reference" if tracking.joints else ""


def _against(axis: Any, tracking: TrackingCurves, quantity: str, length: str) -> None:
    joints, named = tracking.measured, False
    for index, joint in enumerate(joints):
        state, reference = tracking.state_of(joint), tracking.reference_of(joint)
        measured = None if state is None else state.of(quantity, joint)
        if measured is None and state is not None and quantity == "velocity":
            measured = state.slope(joint)
        if measured is not None:
            line(axis, measured, _label(tracking, joint, joints, length), index)
        wanted = None if reference is None else reference.of(quantity, joint)
        if wanted is not None:
            line(axis, wanted, "_" if named else "reference", index, dashed=True)
            named = True
    legend(axis)


def draw_torque(axis: Any, tracking: TrackingCurves) -> None:
    """Plot applied torques, each joint with its limit, over the commands; forces of prismatic ones.

    Where the effort is not measured, a command is applied up to the limit of its joint.
    """
    joints = _driven(tracking)
    turns = [not tracking.is_prismatic(joint) for joint in joints]
    axis.set_title("torque" if all(turns) else "torque, force" if any(turns) else "force")
    axis.set_ylabel(f"{axis.get_title()} {_unit(tracking, joints, 'N·m', 'N')}")
    if not joints:
        write_instead(axis, "no torques in this recording")
        return
    largest, limits, named = 0.0, dict[float, list[int]](), False
    for joint in joints:
        index = tracking.measured.index(joint) if joint in tracking.measured else 0
        limit = _limit(joint, tracking.state_of(joint), *tracking.torques)
        applied, commanded = _torques(tracking, joint, limit)
        label = _label(tracking, joint, joints, "N")
        line(axis, applied, f"{label}, ±{limit:g}" if limit else label, index)
        if commanded is not None:
            line(axis, commanded, "_" if named else "commanded", index, dashed=True)
            named = True
        sizes = [np.abs(values) for _, values in (applied, commanded or applied)]
        largest = max(largest, *(float(np.nanmax(size, initial=0.0)) for size in sizes))
        limits.setdefault(limit, []).append(index)
    for limit, indices in sorted(limits.items()):
        if 0 < limit < _NEAR * largest:
            _draw_limit(axis, limit, indices)
    legend(axis)


def _draw_limit(axis: Any, limit: float, indices: Sequence[int]) -> None:
    """Draw a limit in the colour of its joint, or grey where several have it."""
    style = {"color": colour(indices[0]) if len(indices) == 1 else "grey", "linestyle": ":"}
    axis.axhline(limit, label=f"limit ±{limit:g}", linewidth=1.3, **style)
    axis.axhline(-limit, linewidth=1.3, **style)


def _driven(tracking: TrackingCurves) -> list[str]:
    """Return the joints with a commanded torque; without one, those whose torque is measured."""
    commanded = [joint for signal in tracking.torques for joint in signal.names]
    if commanded:
        return list(dict.fromkeys(commanded))
    states = ((joint, tracking.state_of(joint)) for joint in tracking.measured)
    return [joint for joint, state in states if state is not None and "effort" in state.fields]


def _torques(tracking: TrackingCurves, joint: str, limit: float) -> tuple[Line, Line | None]:
    """Return what was applied to a joint, and what was commanded; None: the same, or nothing."""
    state = tracking.state_of(joint)
    measured = None if state is None else state.of("effort", joint)
    lines = (signal.of("values", joint) for signal in tracking.torques)
    commanded = next((found for found in lines if found is not None), None)
    if commanded is None or measured is not None:
        return measured or (np.empty(0), np.empty(0)), commanded
    t, values = commanded
    if not limit or not np.any(np.abs(values) > limit):
        return commanded, None
    return (t, np.clip(values, -limit, limit)), commanded


def _limit(joint: str, *signals: SignalCurves | None) -> float:
    """Return the least limit of a joint's torque; 0: none is known, or there is none."""
    found = [
        float(signal.limits["effort"][list(signal.names).index(joint)])
        for signal in signals
        if signal is not None and joint in signal.names and signal.limits.get("effort")
    ]
    limit = min(found, default=0.0)
    return limit if np.isfinite(limit) else 0.0


def _unit(tracking: TrackingCurves, joints: Sequence[str], angle: str, length: str) -> str:
    """Return the unit of an axis; both where some joints turn and others slide."""
    prismatic = [tracking.is_prismatic(joint) for joint in joints]
    units = [angle] if not any(prismatic) else [length] if all(prismatic) else [angle, length]
    return ", ".join(f"[{unit}]" for unit in units)


def _label(tracking: TrackingCurves, joint: str, joints: Sequence[str], length: str) -> str:
    """Return a joint's name, with the unit of one that slides where others turn."""
    prismatic = [tracking.is_prismatic(other) for other in joints]
    is_odd = tracking.is_prismatic(joint) and not all(prismatic)
    return f"{joint} [{length}]" if is_odd else joint
