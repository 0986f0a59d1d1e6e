"""Plots of a mobile manipulator's devices: base, gripper and the height of its tool."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.signals import Array
from stepbus_orchestrator.recording import Port, Recording
from stepbus_schemas import Goal, Poses

Panel = Callable[[Any], None]
"""Draws on an axis of matplotlib."""

_BLUE, _ORANGE, _GREEN, _GREY = "#1f77b4", "#d95f02", "#2ca02c", "#7f7f7f"
_TIME = "simulation time [s]"


def device_panels(recording: Recording) -> list[Panel]:
    """Return a panel for each device there is: path and speed of a base, gripper, height.

    Of several bases or grippers the first one is shown.
    """
    base = _first(recording, "BaseState/1")
    gripper = _first(recording, "GripperState/1")
    panels: list[Panel] = []
    if base is not None:
        panels += [lambda axis: _path(axis, base), lambda axis: _speed(axis, base, gripper)]
    if gripper is not None:
        panels.append(lambda axis: _gripper(axis, gripper))
    height = _height(recording) if panels else None
    if height is not None:
        tip, t, z = height
        panels.append(lambda axis: _draw_height(axis, tip, (t, z), gripper))
    return panels


def _first(recording: Recording, type_name: str) -> Port | None:
    """Return the first port of a type, unless it has no messages."""
    port = next(iter(recording.of_type(type_name)), None)
    return port if port is not None and len(port) else None


def _height(recording: Recording) -> tuple[str, Array, Array] | None:
    """Return name, times [s] and heights [m] of the link that goals send to poses."""
    tips = [
        goal.tip
        for port in recording.of_type("Goal/1")
        for _, goal in port.messages()
        if isinstance(goal, Goal) and goal.tip
    ]
    poses = _first(recording, "Poses/1")
    tip = next((tip for tip in tips if poses is not None and tip in poses.names), None)
    if poses is None or tip is None:
        return None
    at = list(poses.names).index(tip)
    rows = [m.position[at][2] for _, m in poses.messages() if isinstance(m, Poses)]
    return tip, poses.t, np.array(rows)


def _path(axis: Any, base: Port) -> None:
    """Plot where the base was, and where it faced at both ends."""
    x, y, yaw = base["x"], base["y"], base["yaw"]
    axis.set_title("path of the base, by odometry")
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.plot(x, y, color=_BLUE, linewidth=2, alpha=0.7)
    far = int(np.argmax(np.hypot(x - x[0], y - y[0])))
    for at, text, color in ((0, "start", _GREEN), (far, "farthest", _GREY), (-1, "end", _ORANGE)):
        label = f"{text}, {base.t[at]:.1f} s"
        axis.plot(x[at], y[at], "o", color=color, markersize=9, label=label)
        ahead = (0.15 * np.cos(yaw[at]), 0.15 * np.sin(yaw[at]))
        axis.annotate(
            "",
            xytext=(x[at], y[at]),
            xy=(x[at] + ahead[0], y[at] + ahead[1]),
            arrowprops={"arrowstyle": "->", "color": color, "linewidth": 2},
        )
    _square(axis, x, y)
    axis.legend(loc="best", fontsize=9)


def _square(axis: Any, x: Array, y: Array) -> None:
    """Give both directions one scale, and a metre at least."""
    half = max(float(np.ptp(x)), float(np.ptp(y)), 1.0) / 2 + 0.25
    axis.set_xlim((x.min() + x.max()) / 2 - half, (x.min() + x.max()) / 2 + half)
    axis.set_ylim((y.min() + y.max()) / 2 - half, (y.min() + y.max()) / 2 + half)
    axis.set_aspect("equal", adjustable="box")


def _speed(axis: Any, base: Port, gripper: Port | None) -> None:
    axis.set_title("velocity of the base")
    axis.set_xlabel(_TIME)
    axis.set_ylabel("[m/s], [rad/s]")
    axis.plot(base.t, base["vx"], color=_BLUE, linewidth=2, label="forward [m/s]")
    axis.plot(base.t, base["wz"], color=_ORANGE, linewidth=2, label="turning [rad/s]")
    _shade(axis, gripper)
    axis.legend(loc="best", fontsize=9)


def _gripper(axis: Any, gripper: Port) -> None:
    """Plot width to the left and force to the right."""
    t = gripper.t
    axis.set_title("gripper")
    axis.set_xlabel(_TIME)
    axis.set_ylabel("width [mm]")
    axis.plot(t, 1e3 * gripper["width"], color=_BLUE, linewidth=2, label="width [mm]")
    right = axis.twinx()
    right.set_ylabel("force [N]")
    right.plot(t, gripper["force"], color=_ORANGE, linewidth=1.2, label="force [N]")
    axis.set_ylim(bottom=0)
    right.set_ylim(bottom=0)
    _shade(axis, gripper)
    handles = [*axis.get_legend_handles_labels()[0], *right.get_legend_handles_labels()[0]]
    axis.legend(handles=handles, loc="best", fontsize=9)


def _draw_height(axis: Any, tip: str, line: tuple[Array, Array], gripper: Port | None) -> None:
    axis.set_title(f"height of {tip}")
    axis.set_xlabel(_TIME)
    axis.set_ylabel("z [m]")
    axis.plot(*line, color=_BLUE, linewidth=2)
    axis.set_ylim(bottom=min(0.0, float(line[1].min())))
    _shade(axis, gripper)
    if axis.get_legend_handles_labels()[0]:
        axis.legend(loc="best", fontsize=9)


def _shade(axis: Any, gripper: Port | None) -> None:
    """Mark when the gripper held something."""
    if gripper is None:
        return
    for number, (start, end) in enumerate(holding_spans(gripper.t, gripper["holding"] > 0)):
        label = "holding" if number == 0 else None
        axis.axvspan(start, end, color=_GREEN, alpha=0.12, linewidth=0, label=label)


def holding_spans(t: Array, holding: np.ndarray) -> list[tuple[float, float]]:
    """Return (start, end) of each time during which something is true [s].

    t: times, shape (m,), [s]. holding: whether it is then, shape (m,).
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holding, [False]]).astype(int)))
    last = len(t) - 1
    return [
        (float(t[start]), float(t[min(end, last)]))
        for start, end in zip(edges[::2], edges[1::2], strict=True)
    ]
