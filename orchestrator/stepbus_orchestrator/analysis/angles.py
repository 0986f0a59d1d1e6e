"""Angles that nobody means: degrees in goals and in parameters of missions."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from stepbus_orchestrator.recording import Recording
from stepbus_participant.parameters import Keys, dotted
from stepbus_schemas import Goal

GOAL = "Goal/1"
FULL_TURN = 2 * math.pi + 1e-3
_ANGLES = frozenset(("gripper_yaw", "phase", "rpy", "yaw"))
"""Parameters whose angles no message shows: a phase is part of a sine, an orientation of a pose."""


def in_degrees(angle: float) -> str:
    """Return the question whether an angle [rad] is one in degrees, as the end of a sentence."""
    return f"; is it in degrees? {angle:.4g}° is {math.radians(angle):.4g} rad"


def goal_targets(recording: Recording) -> Iterator[tuple[str, str, float]]:
    """Yield port, joint and target of each joint that a goal moves [rad or m]."""
    for topic, goal in _goals(recording):
        for joint, value in zip(goal.joints, goal.values, strict=False):
            yield topic, joint, value


def goal_turns(recording: Recording) -> Iterator[str]:
    """Yield a sentence for the largest turn of a base beyond a full one, by port and what it is."""
    worst: dict[tuple[str, str], float] = {}
    for topic, goal in _goals(recording):
        angles = {"a base turns by": goal.by} if goal.type == "turn" else {}
        if goal.base is not None:
            angles["a base turns to"] = goal.base[2]
        for what, angle in angles.items():
            worst[topic, what] = max(worst.get((topic, what), 0.0), angle, key=abs)
    for (topic, what), angle in worst.items():
        if abs(angle) > FULL_TURN:
            yield f"{topic}: {what} {_turns(angle)}"


def parameter_angles(rows: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield a sentence for each angle beyond a full turn in the parameters of missions.

    rows: participants of a scenario. Missions are those that publish references or goals.
    """
    for name, row in rows.items():
        outputs = row.get("outputs")
        types = list(outputs.values()) if isinstance(outputs, dict) else []
        if not {GOAL, "JointReference/1"}.isdisjoint(map(str, types)):
            for keys, angle in _angles(row.get("params"), ()):
                if abs(angle) > FULL_TURN:
                    yield f"{dotted((name, 'params', *keys))} is {_turns(angle)}"


def _turns(angle: float) -> str:
    return f"{angle:.4g} rad, {abs(angle) / (2 * math.pi):.3g} turns{in_degrees(angle)}"


def _goals(recording: Recording) -> Iterator[tuple[str, Goal]]:
    for port in recording.of_type(GOAL):
        for _, goal in port.messages():
            if isinstance(goal, Goal):
                yield port.topic.replace("/", ".", 1), goal


def _angles(value: Any, keys: Keys) -> Iterator[tuple[Keys, float]]:
    """Yield the angles below a value, each with its keys."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _angles(item, (*keys, str(key)))
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for index, item in enumerate(value):
            yield from _angles(item, (*keys, index))
    elif isinstance(value, int | float) and not _ANGLES.isdisjoint(keys):
        yield keys, float(value)
