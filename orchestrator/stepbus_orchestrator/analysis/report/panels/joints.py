"""Plots of many joints, each arm apart: a panel for each joint, the errors, angles over index."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.report.curves.curve import Line
from stepbus_orchestrator.analysis.report.curves.tracking import SignalCurves, TrackingCurves
from stepbus_orchestrator.analysis.signals import Array

from .style import colour, legend, line

# Less than this is noise, not motion.
_LEAST_SPAN = 1.0
"""[°]"""
_LEAST_SPAN_M = 1e-3
"""[m]"""
_COLUMNS = 4
_LEAST_JOINTS = 3
_OTHERS = "others"
_MOST_LEVEL = 8
"""More names than that stand upright under an axis."""
_MEASURED = {"color": "#1f77b4", "linewidth": 2.0}
_TARGET = {"color": "#d95f02", "linewidth": 1.4, "linestyle": (0, (4, 3))}


def arms(joints: Sequence[str]) -> dict[str, list[str]]:
    """Return arm → joints: those that share what stands before the first underscore.

    An arm has at least three joints; the rest are `others`. Where there are not several arms, all
    are one without a name.
    """
    groups: dict[str, list[str]] = {}
    for joint in joints:
        groups.setdefault(joint.partition("_")[0] if "_" in joint else "", []).append(joint)
    found = {name: rows for name, rows in groups.items() if name and len(rows) >= _LEAST_JOINTS}
    if len(found) < 2:
        return {"": list(joints)}
    rest = [joint for joint in joints if not any(joint in rows for rows in found.values())]
    return found | ({_OTHERS: rest} if rest else {})


def draw_panels(
    figure: Any, tracking: TrackingCurves, more: Sequence[Callable[[Any], None]] = ()
) -> None:
    """Draw each arm: a panel per measured joint, one of its errors; then angles over joint index.

    figure: of matplotlib, with a constrained layout. more: panels for the last row. Angles are in
    degrees, prismatic joints in m. Lines that mean the same have one colour.
    """
    if not tracking.measured:
        return
    groups = arms(tracking.measured)
    heights = [_rows(arm, joints) for arm, joints in groups.items()]
    parts = figure.subfigures(len(groups) + 1, 1, height_ratios=[*heights, 1.3])
    for number, (part, (arm, joints)) in enumerate(zip(parts, groups.items(), strict=False)):
        _draw_arm(part, tracking, arm, joints)
        if number == 0:
            handles, labels = part.axes[0].get_legend_handles_labels()
            part.legend(handles, labels, loc="outside upper right", ncols=2, fontsize=12)
    named = {arm: joints for arm, joints in groups.items() if arm != _OTHERS}
    axes = parts[-1].subplots(1, len(named) + len(more), squeeze=False)[0]
    for axis, (arm, joints) in zip(axes, named.items(), strict=False):
        _over_index(axis, tracking, arm, joints)
    for axis, panel in zip(axes[len(named) :], more, strict=True):
        panel(axis)
        axis.grid(visible=True, alpha=0.3)


def panel_rows(tracking: TrackingCurves) -> int:
    """Return how many rows of panels there are."""
    return sum(_rows(arm, joints) for arm, joints in arms(tracking.measured).items()) + 1


def _count(arm: str, joints: Sequence[str]) -> int:
    """Return how many panels an arm has: one for each joint, and one of their errors."""
    return len(joints) + (arm != _OTHERS)


def _rows(arm: str, joints: Sequence[str]) -> int:
    return -(-_count(arm, joints) // _COLUMNS)


def _draw_arm(figure: Any, tracking: TrackingCurves, arm: str, joints: Sequence[str]) -> None:
    if arm:
        figure.suptitle(arm, fontsize=14, x=0.01, ha="left")
    axes = figure.subplots(_rows(arm, joints), _COLUMNS, sharex=True, squeeze=False).flatten()
    for axis, joint in zip(axes, joints, strict=False):
        state = tracking.state_of(joint)
        if state is not None:
            _panel(axis, tracking, state, joint)
    count = _count(arm, joints)
    if count > len(joints):
        _errors(axes[len(joints)], tracking, arm, joints)
    for axis in axes[count:]:
        axis.set_axis_off()
    for axis in axes[:count][-_COLUMNS:]:
        axis.set_xlabel("simulation time [s]")
        axis.tick_params(labelbottom=True)


def _panel(axis: Any, tracking: TrackingCurves, state: SignalCurves, joint: str) -> None:
    is_prismatic = tracking.is_prismatic(joint)
    scale, unit = _scale(tracking, joint)
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


def _errors(axis: Any, tracking: TrackingCurves, arm: str, joints: Sequence[str]) -> None:
    """Plot target minus measured position of all joints of an arm."""
    axis.set_title(f"{arm} error: target − measured".strip())
    axis.grid(visible=True, alpha=0.3)
    axis.margins(x=0.01)
    units = {_scale(tracking, joint)[1]: None for joint in joints}
    axis.set_ylabel(", ".join(f"[{unit}]" for unit in units))
    axis.axhline(0.0, color="black", linewidth=0.8)
    for index, joint in enumerate(joints):
        if joint in tracking.joints or (tracking.has_targets and not tracking.joints):
            t, values = tracking.error(joint)
            points = (t, _scale(tracking, joint)[0] * values)
            line(axis, points, joint.removeprefix(f"{arm}_"), index)
    legend(axis)


def _over_index(axis: Any, tracking: TrackingCurves, arm: str, joints: Sequence[str]) -> None:
    """Plot where each joint was, over its index: the range, and the end over its target."""
    axis.set_title(f"{arm} joints over their index: range, end, target".strip())
    units = {_scale(tracking, joint)[1]: None for joint in joints}
    axis.set_ylabel(", ".join(f"[{unit}]" for unit in units))
    axis.grid(visible=True, alpha=0.3)
    for index, joint in enumerate(joints):
        state, scale = tracking.state_of(joint), _scale(tracking, joint)[0]
        measured = None if state is None else state.of("position", joint)
        if state is None or measured is None or not len(measured[1]):
            continue
        t, values = measured[0], scale * measured[1]
        target = _target_of(tracking, state, joint)
        ends = [float(np.nanmin(values)), float(np.nanmax(values))]
        names = ("range", "end", "target then") if index == 0 else ("_", "_", "_")
        bar = {"color": colour(0), "alpha": 0.35, "linewidth": 8, "solid_capstyle": "butt"}
        axis.plot([index] * 2, ends, label=names[0], **bar)
        last = t[-1] if target is None or not len(target[0]) else min(t[-1], target[0][-1])
        axis.plot(index, np.interp(last, t, values), "o", color=colour(0), label=names[1])
        if target is not None and len(target[1]):
            mark = {"color": _TARGET["color"], "markersize": 18, "markeredgewidth": 2}
            axis.plot(index, scale * target[1][-1], "_", label=names[2], **mark)
    labels = [f"{i} {joint.removeprefix(f'{arm}_')}" for i, joint in enumerate(joints)]
    turn = 90 if len(joints) > _MOST_LEVEL else 0
    axis.set_xticks(range(len(joints)), labels, fontsize=9, rotation=turn)
    legend(axis)


def _scale(tracking: TrackingCurves, joint: str) -> tuple[float, str]:
    """Return the factor from the unit of a joint to the one that is shown, and that."""
    return (1.0, "m") if tracking.is_prismatic(joint) else (float(np.degrees(1.0)), "°")


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
