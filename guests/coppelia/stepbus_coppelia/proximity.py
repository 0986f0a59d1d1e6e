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
    rays: list[Point] = [(0.0, 0.0, 1.0)]
    for ring in range(1, _RINGS + 1 if angle else 1):
        tilt = angle / 2 * ring / _RINGS
        for spoke in range(_SPOKES):
            turn = 2 * math.pi * spoke / _SPOKES
            sine = math.sin(tilt)
            rays.append((sine * math.cos(turn), sine * math.sin(turn), math.cos(tilt)))
    return rays


def reading(scene: Scene, thing: SceneObject) -> tuple[Any, ...] | None:
    """Return what a proximity sensor detects nearest, as `readProximitySensor`; None: nothing."""
    settings: ProximitySettings = thing.sensor
    frame = scene.world_pose(thing)
    rays = np.array(directions(settings.angle)) @ rotation(frame[1]).T
    at = np.array(frame[0])
    # From outside of what the sensor sits on.
    starts = at + rays * max(settings.offset, 1e-4)
    shares = scene.engine.cast(starts, at + rays * settings.range)
    best = int(np.argmin(shares))
    if not math.isfinite(shares[best]):
        return None
    reach = settings.range - max(settings.offset, 1e-4)
    distance = max(settings.offset, 1e-4) + float(shares[best]) * reach
    hit = at + rays[best] * distance
    local = [value * distance for value in directions(settings.angle)[best]]
    handle = _hit(scene, hit, thing)
    return (1, distance, local, handle, [-value / distance for value in local])


def _hit(
    scene: Scene, hit: "np.ndarray[tuple[int], np.dtype[np.float64]]", own: SceneObject
) -> int:
    """Return the handle of the smallest link whose box a point is in; -1: of none."""
    found: list[tuple[float, int]] = []
    for link in {**scene.physics.links}.values():
        if link == own.link or not scene.engine.is_solid(link):
            continue
        low, high = map(np.array, scene.engine.box(link))
        if np.all(hit >= low - _NEAR) and np.all(hit <= high + _NEAR):
            found.append((float(np.prod(high - low)), scene.of(link).handle))
    return min(found, default=(0.0, -1))[1]
