"""Plots of a mobile manipulator's devices: base, gripper and the height of its hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.signals import Array
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import BaseState, Goal, GripperState, Message, Poses

Panel = Callable[[Any], None]
"""Draws on an axis of matplotlib."""

_BLUE, _ORANGE, _GREEN, _GREY = "#1f77b4", "#d95f02", "#2ca02c", "#7f7f7f"
_TIME = "simulation time [s]"


@dataclass(frozen=True, kw_only=True)
class _Series:
    """Messages of one port; t: simulation time of each, shape (m,), [s]."""

    t: Array
    messages: Sequence[Message]

    def of(self, name: str) -> Array:
        """Return one field of all messages, shape (m,)."""
        return np.array([getattr(message, name) for message in self.messages], dtype=float)


def device_panels(recording: Recording) -> list[Panel]:
    """Return a panel for whatever the recording has: path and speed of a base, gripper, hand.

    Of several bases or grippers the first one is shown.
    """
    base = _read(recording, "BaseState/1", BaseState)
    hand = _read(recording, "GripperState/1", GripperState)
    panels: list[Panel] = []
    if base is not None:
        panels += [lambda axis: _path(axis, base), lambda axis: _speed(axis, base, hand)]
    if hand is not None:
        panels.append(lambda axis: _gripper(axis, hand))
    height = _height(recording) if panels else None
    if height is not None:
        tip, t, z = height
        panels.append(lambda axis: _draw_height(axis, tip, (t, z), hand))
    return panels


def _read(recording: Recording, type_name: str, kind: type[Message]) -> _Series | None:
    for port in recording.of_type(type_name):
        messages = [m for _, m in recording.messages(port.topic) if isinstance(m, kind)]
        t = [entry.t_ns * 1e-9 for entry in recording.entries[port.topic]]
        return _Series(t=np.array(t), messages=messages) if messages else None
    return None


def _height(recording: Recording) -> tuple[str, Array, Array] | None:
    """Return name, times [s] and heights [m] of the link that goals send to poses."""
    tips = [
        goal.tip
        for port in recording.of_type("Goal/1")
        for _, goal in recording.messages(port.topic)
        if isinstance(goal, Goal) and goal.tip
    ]
    for port in recording.of_type("Poses/1"):
        names = list(port.description.names)
        tip = next((tip for tip in tips if tip in names), None)
        poses = _read(recording, "Poses/1", Poses)
        if tip is not None and poses is not None:
            at = names.index(tip)
            rows = [m.position[at][2] for m in poses.messages if isinstance(m, Poses)]
            return tip, poses.t, np.array(rows)
    return None


def _path(axis: Any, base: _Series) -> None:
    """Plot where the base was, and which way it looked at both ends."""
    x, y, yaw = base.of("x"), base.of("y"), base.of("yaw")
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


def _speed(axis: Any, base: _Series, hand: _Series | None) -> None:
    axis.set_title("velocity of the base")
    axis.set_xlabel(_TIME)
    axis.set_ylabel("[m/s], [rad/s]")
    axis.plot(base.t, base.of("vx"), color=_BLUE, linewidth=2, label="forward [m/s]")
    axis.plot(base.t, base.of("wz"), color=_ORANGE, linewidth=2, label="turning [rad/s]")
    _shade(axis, hand)
    axis.legend(loc="best", fontsize=9)


def _gripper(axis: Any, hand: _Series) -> None:
    """Plot width to the left and force to the right."""
    axis.set_title("gripper")
    axis.set_xlabel(_TIME)
    axis.set_ylabel("width [mm]")
    axis.plot(hand.t, 1e3 * hand.of("width"), color=_BLUE, linewidth=2, label="width [mm]")
    right = axis.twinx()
    right.set_ylabel("force [N]")
    right.plot(hand.t, hand.of("force"), color=_ORANGE, linewidth=1.2, label="force [N]")
    axis.set_ylim(bottom=0)
    right.set_ylim(bottom=0)
    _shade(axis, hand)
    handles = [*axis.get_legend_handles_labels()[0], *right.get_legend_handles_labels()[0]]
    axis.legend(handles=handles, loc="best", fontsize=9)


def _draw_height(axis: Any, tip: str, line: tuple[Array, Array], hand: _Series | None) -> None:
    axis.set_title(f"height of {tip}")
    axis.set_xlabel(_TIME)
    axis.set_ylabel("z [m]")
    axis.plot(*line, color=_BLUE, linewidth=2)
    axis.set_ylim(bottom=min(0.0, float(line[1].min())))
    _shade(axis, hand)
    if axis.get_legend_handles_labels()[0]:
        axis.legend(loc="best", fontsize=9)


def _shade(axis: Any, hand: _Series | None) -> None:
    """Mark when the gripper held something."""
    if hand is None:
        return
    for number, (start, end) in enumerate(held_spans(hand.t, hand.of("holding") > 0)):
        label = "holding" if number == 0 else None
        axis.axvspan(start, end, color=_GREEN, alpha=0.12, linewidth=0, label=label)


def held_spans(t: Array, holding: np.ndarray) -> list[tuple[float, float]]:
    """Return (start, end) of each time during which something is true [s].

    t: times, shape (m,), [s]. holding: whether it is then, shape (m,).
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holding, [False]]).astype(int)))
    last = len(t) - 1
    return [
        (float(t[start]), float(t[min(end, last)]))
        for start, end in zip(edges[::2], edges[1::2], strict=True)
    ]
