"""What stands and walks in the way of the base: posts, crates and people."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

Action = dict[str, Any]
Script = dict[str, Any]
Point = tuple[float, float]

_FAR = 1.6
"""How far beside the aisle people come from, and go to [m]."""

_PACES = (0.4, 1.6)
"""The slowest and the fastest who walks [m/s]."""


def put(body: str, at: float, x: float, y: float, *, z: float = 0.0, yaw: float = 0.0) -> Action:
    """Return an action; at: its time [s]. x, y, z, yaw: of the body [m, rad]."""
    position = [round(part, 5) for part in (x, y, z)]
    action: Action = {"at": f"{max(at, 0.001):.3f}s", "body": body, "position": position}
    return {**action, "orientation_rpy": [0, 0, yaw]} if yaw else action


def _walk(at: float, points: Sequence[Point], speed: float) -> list[Action]:
    """Return the actions of somebody who walks along points [m, m/s]; at: when he starts [s]."""
    at = max(at, 0.1)
    rows = [put("crate", at - 0.05, *points[0])]
    for a, b in pairwise(points):
        over = math.dist(a, b) / speed
        to = [round(b[0], 3), round(b[1], 3), 0.0]
        rows.append({"at": f"{at:.3f}s", "body": "crate", "to": to, "over": f"{over:.3f}s"})
        at += over + 0.02
    return rows


def _either(chance: random.Random, out: Point, home: Point) -> float:
    """Return a time while the base drives to the shelf, or while it drives home [s]."""
    return chance.uniform(*chance.choice([out, home]))


def _post(chance: random.Random, at: float, x: Point, y: Point) -> Script:
    """Return a post or a crate that appears somewhere [s, m]."""
    body = chance.choice(["pillar", "crate"])
    return {"script": [put(body, at, chance.uniform(*x), chance.uniform(*y))]}


def post_out(chance: random.Random, _: Mapping[str, Any]) -> Script:
    """Put a post or a crate on the way to the shelf."""
    at = chance.choice([0.0, chance.uniform(0.2, 0.6)])
    return _post(chance, at, (0.55, 1.25), (-0.4, 0.4))


def post_home(chance: random.Random, _: Mapping[str, Any]) -> Script:
    """Put one on the way home while the arm is at the shelf."""
    return _post(chance, chance.uniform(5.5, 7.4), (0.5, 0.8), (-0.35, 0.35))


def post_at_goal(chance: random.Random, _: Mapping[str, Any]) -> Script:
    """Put one near a place where the base is about to stand."""
    if chance.random() < 0.5:
        return _post(chance, 0.0, (1.3, 1.6), (-0.7, 0.7))
    return _post(chance, chance.uniform(4.0, 7.4), (-0.35, 0.2), (-0.5, 0.1))


def crossing(chance: random.Random, _: Mapping[str, Any]) -> Script:
    """Send somebody across the way."""
    speed, x = chance.uniform(*_PACES), chance.uniform(0.72, 1.15)
    side, drift = chance.choice([-_FAR, _FAR]), chance.uniform(-0.02, 0.2)
    at = _either(chance, (0.8, 2.2), (8.0, 9.6)) - _FAR / speed
    return {"script": _walk(at, [(x, side), (x + drift, -side)], speed)}


def following(chance: random.Random, _: Mapping[str, Any]) -> Script:
    """Send somebody along the way, behind the base."""
    speed = chance.uniform(*_PACES)
    if chance.random() < 0.5:
        ends = [(-_FAR, chance.uniform(-0.2, 0.2))]
        ends += [(chance.uniform(0.2, 0.6), chance.uniform(-0.2, 0.2))]
        return {"script": _walk(chance.uniform(0.2, 1.2), ends, speed)}
    ends = [(1.3, _FAR), (1.25, chance.uniform(-0.1, 0.3))]
    ends += [(chance.uniform(0.7, 0.9), chance.uniform(-0.1, 0.2))]
    return {"script": _walk(chance.uniform(9.2, 9.8), ends, speed)}


def standing(chance: random.Random, _: Mapping[str, Any]) -> Script:
    """Send somebody into the way who stands there, for some seconds or for good."""
    speed, x, y = chance.uniform(*_PACES), chance.uniform(0.6, 1.1), chance.uniform(-0.3, 0.3)
    side = chance.choice([-_FAR, _FAR])
    at = max(_either(chance, (0.8, 2.0), (7.8, 9.0)) - _FAR / speed, 0.1)
    script = _walk(at, [(x, side), (x, y)], speed)
    if chance.random() < 0.7:
        leaves = at + abs(side - y) / speed + chance.uniform(2.0, 6.0)
        script += _walk(leaves, [(x, y), (x, side)], speed)[1:]
    return {"script": script}


def turning(chance: random.Random, _: Mapping[str, Any]) -> Script:
    """Send somebody towards the way who turns back."""
    speed, x = chance.uniform(*_PACES), chance.uniform(0.6, 1.1)
    side = chance.choice([-1.0, 1.0])
    near, back = side * chance.uniform(0.1, 0.6), x + chance.uniform(-0.3, 0.3)
    at = _either(chance, (0.8, 2.0), (8.0, 9.4)) - _FAR / speed
    return {"script": _walk(at, [(x, side * _FAR), (x, near), (back, side * _FAR)], speed)}
