"""Plots of a mobile manipulator's devices: base, gripper and the height of its tool."""

from collections.abc import Callable
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.report.curves.devices import Columns, Devices, Height, Path
from stepbus_orchestrator.analysis.signals import Array
from stepbus_orchestrator.recording import Recording

from .style import legend

Panel = Callable[[Any], None]
"""Draws on an axis of matplotlib."""

_BLUE, _ORANGE, _GREEN, _GREY = "#1f77b4", "#d95f02", "#2ca02c", "#7f7f7f"
_TIME = "simulation time [s]"


def device_panels(recording: Recording) -> list[Panel]:
    """Return a panel for each device there is: path and speed of a base, gripper, height.

    Of several bases or grippers the first one is shown.
    """
    found = Devices(recording)
    gripper, height = found.gripper, found.height
    panels: list[Panel] = []
    if found.base:
        panels.append(lambda axis: _path(axis, found.path))
        panels.append(lambda axis: _speed(axis, found.base, gripper))
    if gripper:
        panels.append(lambda axis: _gripper(axis, gripper))
    if height is not None:
        panels.append(lambda axis: _height(axis, height, gripper))
    return panels


def _path(axis: Any, path: Path) -> None:
    """Plot where the base was, and where it faced at both ends."""
    x, y = path.points()
    axis.set_title("path of the base, by odometry")
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.plot(x, y, color=_BLUE, linewidth=2, alpha=0.7)
    marked = (
        (path.start, "start", _GREEN),
        (path.farthest, "farthest", _GREY),
        (path.end, "end", _ORANGE),
    )
    for at, text, color in marked:
        label = f"{text}, {at.t:.1f} s"
        axis.plot(at.x, at.y, "o", color=color, markersize=9, label=label)
        ahead = (0.15 * np.cos(at.yaw), 0.15 * np.sin(at.yaw))
        axis.annotate(
            "",
            xytext=(at.x, at.y),
            xy=(at.x + ahead[0], at.y + ahead[1]),
            arrowprops={"arrowstyle": "->", "color": color, "linewidth": 2},
        )
    _square(axis, x, y)
    legend(axis)


def _square(axis: Any, x: Array, y: Array) -> None:
    """Give both directions one scale, and a metre at least."""
    half = max(float(np.ptp(x)), float(np.ptp(y)), 1.0) / 2 + 0.25
    axis.set_xlim((x.min() + x.max()) / 2 - half, (x.min() + x.max()) / 2 + half)
    axis.set_ylim((y.min() + y.max()) / 2 - half, (y.min() + y.max()) / 2 + half)
    axis.set_aspect("equal", adjustable="box")


def _speed(axis: Any, base: Columns, gripper: Columns) -> None:
    axis.set_title("velocity of the base")
    axis.set_xlabel(_TIME)
    axis.set_ylabel("[m/s], [rad/s]")
    axis.plot(*base["vx"], color=_BLUE, linewidth=2, label="forward [m/s]")
    axis.plot(*base["wz"], color=_ORANGE, linewidth=2, label="turning [rad/s]")
    _shade(axis, gripper)
    legend(axis)


def _gripper(axis: Any, gripper: Columns) -> None:
    """Plot width to the left and force to the right."""
    t, width = gripper["width"]
    axis.set_title("gripper")
    axis.set_xlabel(_TIME)
    axis.set_ylabel("width [mm]")
    axis.plot(t, 1e3 * width, color=_BLUE, linewidth=2, label="width [mm]")
    right = axis.twinx()
    right.set_ylabel("force [N]")
    right.plot(*gripper["force"], color=_ORANGE, linewidth=1.2, label="force [N]")
    for one, values in ((axis, 1e3 * width), (right, gripper["force"][1])):
        one.set_ylim(0, 1.1 * max(float(values.max()), 1.0))
    _shade(axis, gripper)
    handles = [*axis.get_legend_handles_labels()[0], *right.get_legend_handles_labels()[0]]
    legend(axis, handles, right=1.14)


def _height(axis: Any, height: Height, gripper: Columns) -> None:
    t, z = height.line()
    axis.set_title(f"height of {height.tip}")
    axis.set_xlabel(_TIME)
    axis.set_ylabel("z [m]")
    axis.plot(t, z, color=_BLUE, linewidth=2)
    axis.set_ylim(bottom=min(0.0, float(z.min())))
    _shade(axis, gripper)
    legend(axis)


def _shade(axis: Any, gripper: Columns) -> None:
    """Mark when the gripper held something."""
    if not gripper:
        return
    t, holding = gripper["holding"]
    for number, (start, end) in enumerate(holding_spans(t, holding > 0)):
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
