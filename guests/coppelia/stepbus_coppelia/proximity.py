"""Proximity sensors: rays, and cones of rays."""

import math
from typing import Any

import numpy as np

from stepbus_coppelia.params import ProximitySettings
from stepbus_coppelia.scene import Scene, SceneObject
from stepbus_plant.geometry import rotation
from stepbus_schemas import Point

_RINGS, _SPOKES = 4, 12
"""Rays of a cone, beside the one along its axis."""
_NEAR = 2e-3
"""How far outside of a link's box a hit may be that is on it [m]."""


def directions(angle: float) -> list[Point]:
    """Return the rays of a cone about z of an opening angle [rad]; 0: one ray."""
    tilts = [angle / 2 * ring / _RINGS for ring in range(1, _RINGS + 1 if angle else 1)]
    pairs = [(t, 2 * math.pi * spoke / _SPOKES) for t in tilts for spoke in range(_SPOKES)]
    rays = [(math.sin(t) * math.cos(a), math.sin(t) * math.sin(a), math.cos(t)) for t, a in pairs]
    return [(0.0, 0.0, 1.0), *rays]


def reading(scene: Scene, thing: SceneObject) -> tuple[Any, ...] | None:
    """Return what a proximity sensor detects nearest, as `readProximitySensor`; None: nothing."""
    settings: ProximitySettings = thing.sensor
    place, turn = scene.world_pose(thing)
    cone, at = directions(settings.angle), np.array(place)
    rays = np.array(cone) @ rotation(turn).T
    first = max(settings.offset, 1e-4)  # outside of what the sensor sits on
    shares = scene.engine.cast(at + rays * first, at + rays * settings.range)
    best = int(np.argmin(shares))
    if not math.isfinite(shares[best]):
        return None
    distance = first + float(shares[best]) * (settings.range - first)
    local = [value * distance for value in cone[best]]
    handle = _hit(scene, at + rays[best] * distance, thing)
    return (1, distance, local, handle, [-value / distance for value in local])


def _hit(scene: Scene, hit: Any, own: SceneObject) -> int:
    """Return the handle of the smallest link whose box a point is in; -1: of none."""
    found: list[tuple[float, int]] = []
    for link in scene.physics.links.values():
        if link == own.link or not scene.engine.is_solid(link):
            continue
        low, high = map(np.array, scene.engine.box(link))
        if np.all(hit >= low - _NEAR) and np.all(hit <= high + _NEAR):
            found.append((float(np.prod(high - low)), scene.of(link).handle))
    return min(found, default=(0.0, -1))[1]
