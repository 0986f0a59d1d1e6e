"""How far a tip was from the pose of each goal, when that ended."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.report.panels.style import colour, legend
from stepbus_orchestrator.analysis.signals import Array
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import Goal, GoalStatus, Poses

from .devices import moving_poses


@dataclass(frozen=True, kw_only=True)
class PoseError:
    """The end of one goal: distance [m] and angle [rad] of the tip from its pose."""

    tip: str
    position: float
    orientation: float


def pose_errors(recording: Recording) -> list[PoseError]:
    """Return the errors of all goals that sent a link to a pose in the frame of another link.

    The poses are those of the first port that has published them more than once.
    """
    port = moving_poses(recording)
    names = [] if port is None else list(port.names)
    goals = {
        goal.id: goal
        for one in recording.of_type("Goal/1")
        for _, goal in one.messages()
        if isinstance(goal, Goal) and goal.type == "move_to_pose"
        if goal.tip in names and goal.frame in names
        if goal.position is not None and goal.orientation is not None
    }
    if port is None or not goals:
        return []
    ends = _ends(recording, goals)
    found: list[PoseError] = []
    for step, poses in port.messages():
        while ends and ends[0][0] <= step and isinstance(poses, Poses):
            found.append(_error(ends.pop(0)[1], poses, names))
    return found


def _ends(recording: Recording, goals: Mapping[int, Goal]) -> list[tuple[int, Goal]]:
    """Return when each of the goals ended well, in order of time."""
    return [
        (step, goals[status.id])
        for port in recording.of_type("GoalStatus/1")
        for step, status in port.messages()
        if isinstance(status, GoalStatus) and status.state == "succeeded" and status.id in goals
    ]


def _error(goal: Goal, poses: Poses, names: Sequence[str]) -> PoseError:
    tip, frame = names.index(goal.tip), names.index(goal.frame)
    turn = _rotation(poses.orientation[frame])
    away = np.subtract(poses.position[tip], poses.position[frame])
    wanted, towards = goal.position or (0.0, 0.0, 0.0), goal.orientation or (0.0, 0.0, 0.0, 1.0)
    off = turn.T @ away - np.array(wanted)
    between = _rotation(towards).T @ turn.T @ _rotation(poses.orientation[tip])
    sine = np.array([between[2, 1] - between[1, 2], between[0, 2] - between[2, 0],
                     between[1, 0] - between[0, 1]])  # fmt: skip
    angle = float(np.arctan2(np.linalg.norm(sine), np.trace(between) - 1.0))
    return PoseError(tip=goal.tip, position=float(np.linalg.norm(off)), orientation=angle)


def _rotation(quaternion: Sequence[float]) -> Array:
    """Return the matrix of a quaternion x, y, z, w."""
    x, y, z, w = np.array(quaternion) / np.linalg.norm(quaternion)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def draw_pose_errors(axis: Any, errors: Sequence[PoseError]) -> None:
    """Plot the errors, goal by goal: distances to the left, angles to the right."""
    axis.set_title("error of the tip at the end of each goal")
    axis.set_xlabel("goal")
    axis.set_ylabel("position [mm]")
    right = axis.twinx()
    right.set_ylabel("orientation [°]")
    for index, tip in enumerate(dict.fromkeys(error.tip for error in errors)):
        at = [number for number, error in enumerate(errors, 1) if error.tip == tip]
        rows = [error for error in errors if error.tip == tip]
        style = {"color": colour(index), "linestyle": "none"}
        axis.plot(at, [1e3 * e.position for e in rows], marker="o", label=f"{tip} [mm]", **style)
        angles = [float(np.degrees(error.orientation)) for error in rows]
        right.plot(at, angles, marker="x", label=f"{tip} [°]", **style)
    axis.set_ylim(bottom=0.0)
    right.set_ylim(bottom=0.0)
    handles = [*axis.get_legend_handles_labels()[0], *right.get_legend_handles_labels()[0]]
    legend(axis, handles, right=1.16)
