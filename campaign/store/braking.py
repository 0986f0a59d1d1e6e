"""Whether a base that brakes at its limit would not have been touched, by the recording alone."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Pose = tuple[float, float, float]

STEP_S = 0.016
_BRAKE, _REACTION = 4.0, 0.04
"""Of a base at its limit [m/s²], and from a measurement to its effect [s]."""

_LOOK, _STOOD = 0.2, 1.0
"""How long after something comes into view, or starts to move after it has stood for that long,
that can be known [s]."""

_AFTER = 1.5
"""For how long after the touch it would have to stand clear [s]."""

_APART = 0.005
"""What counts as clear [m]."""

_BASE = (0.31, 0.27)
IN_THE_WAY = {"crate_box": (0.15, 0.15), "pillar_post": (0.04, 0.04)}
"""Half of lengths and widths [m]."""

_JUMP, _MOVES = 0.2, 0.003
"""How far something moves within a step that is put elsewhere, and that moves at all [m]."""


def _outline(pose: Pose, half: Sequence[float]) -> Array:
    """Return points around a rectangle, shape (40, 2) [m]."""
    u, ones = np.linspace(-1.0, 1.0, 10), np.ones(10)
    rows = np.concatenate([np.stack(p, 1) for p in ((u, ones), (u, -ones), (ones, u), (-ones, u))])
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    turned: Array = (rows * half) @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]
    return turned


def _outside(points: Array, pose: Pose, half: Sequence[float]) -> float:
    """Return how far the nearest of points is outside a rectangle [m]."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    own = (points - pose[:2]) @ np.array([[cos, -sin], [sin, cos]])
    return float(np.linalg.norm(np.maximum(np.abs(own) - half, 0.0), axis=1).min())


def gap(base: Pose, other: Pose, link: str) -> float:
    """Return the distance of base and link, to a millimetre or two; 0: they touch [m]."""
    half = IN_THE_WAY[link]
    ways = (_outline(base, _BASE), other, half), (_outline(other, half), base, _BASE)
    return min(_outside(*way) for way in ways)


def _pose(row: Mapping[str, Any], n: int) -> Pose:
    (x, y, _), (a, b, c, w) = row["position"][n], row["orientation"][n]
    return x, y, math.atan2(2.0 * (w * c + a * b), 1.0 - 2.0 * (b * b + c * c))


def _standing(base: Pose, speed: float) -> Pose:
    """Return where a base stands that brakes from now on."""
    far = speed * _REACTION + math.copysign(speed**2 / (2.0 * _BRAKE), speed)
    return base[0] + far * math.cos(base[2]), base[1] + far * math.sin(base[2]), base[2]


def avoidable(
    poses: Sequence[tuple[int, Mapping[str, Any]]],
    speeds: Mapping[int, float],
    names: Sequence[str],
    link: str,
    touched: int,
) -> int | None:
    """Return the last step at which braking would have kept the base clear of a link.

    poses: messages with their steps, of the links in names; speeds: step → of the base [m/s].
    touched: step of the first touch. None: there is no such step.
    """
    chassis, thing = names.index("chassis"), names.index(link)
    rows = {step: (_pose(row, chassis), _pose(row, thing)) for step, row in poses}
    steps = [step for step in rows if step <= touched]
    later = [step for step in rows if step <= touched + _AFTER / STEP_S]
    known = _seen(rows, steps) + _LOOK / STEP_S
    for step in (step for step in reversed(steps) if step >= known):
        stands = _standing(rows[step][0], speeds.get(step, 0.0))
        if all(gap(stands, rows[n][1], link) > _APART for n in later if n >= step):
            return step
    return None


def _seen(rows: Mapping[int, tuple[Pose, Pose]], steps: Sequence[int]) -> int:
    """Return when something was put where it is, or started to move after it had stood, at last."""
    far = {b: math.dist(rows[a][1][:2], rows[b][1][:2]) for a, b in pairwise(steps)}
    moves = [steps[0], *(step for step, moved in far.items() if moved > _MOVES)]
    starts = [b for a, b in pairwise(moves) if b - a > _STOOD / STEP_S]
    return max([moves[:2][-1], *starts, *(step for step in moves if far.get(step, 0.0) > _JUMP)])
