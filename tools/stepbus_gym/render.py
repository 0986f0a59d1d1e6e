"""Pictures of a simulation in this process, drawn by the engine of its plant."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepbus_plant.engine import BASE, Light
from stepbus_plant.geometry import Array, projection_matrix, view_matrix
from stepbus_plant.physics import Physics, open_worlds
from stepbus_schemas import RunError

_FIELD_OF_VIEW = math.radians(45.0)
_NEAR, _FAR = 0.05, 200.0
_LARGEST = 50.0
_LIGHT = Light(
    direction=(-50.0, 30.0, 100.0),
    distance=2.0,
    ambient=0.6,
    diffuse=0.35,
    specular=0.05,
    has_shadow=False,
)


@dataclass(frozen=True, kw_only=True)
class Camera:
    """Where pictures are taken from.

    width, height: [pixel]. target: the point in the middle [m]; default: that of all bodies.
    distance: from it [m]; default: all bodies are in the picture. yaw, pitch: [deg]; at 0 it
    looks along y.
    """

    width: int = 480
    height: int = 360
    target: tuple[float, float, float] | None = None
    distance: float | None = None
    yaw: float = 30.0
    pitch: float = -15.0


class Renderer:
    """Takes pictures of what the plant of one run simulates in this process."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._world: Physics | None = None
        self._view: Array | None = None

    @contextlib.contextmanager
    def watching(self) -> Iterator[None]:
        """Find the simulation that starts meanwhile."""
        before = open_worlds()
        yield
        self._world = next((world for world in open_worlds() if world not in before), None)

    def frame(self) -> NDArray[np.uint8]:
        """Return a picture, shape (height, width, 3); raises RunError where there is none."""
        if self._world is None:
            raise RunError("no participant of this scenario is a plant: no pictures")
        camera = self._camera
        if self._view is None:
            self._view = _view(camera, self._world)
        projection = projection_matrix(_FIELD_OF_VIEW, camera.width / camera.height, _NEAR, _FAR)
        size = camera.width, camera.height
        colours, _ = self._world.engine.image(size, self._view, projection, _LIGHT)
        return colours.copy()


def _view(camera: Camera, world: Physics) -> Array:
    """Return the view of all bodies, wherever their joints take them."""
    boxes = [_reach(world, body) for body in range(len(world.bodies))]
    # A floor without an end is no part of the picture.
    boxes = [box for box in boxes if np.max(box[1] - box[0]) < _LARGEST] or boxes
    low, high = np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)
    x, y, z = ((low + high) / 2).tolist()
    distance = camera.distance or 1.1 * float(np.max(high - low)) / 2 / math.tan(_FIELD_OF_VIEW / 2)
    yaw, pitch = math.radians(camera.yaw), math.radians(camera.pitch)
    return view_matrix(camera.target or (x, y, z), distance, yaw, pitch)


def _reach(world: Physics, body: int) -> tuple[Array, Array]:
    """Return the corners of what a body occupies; of one with joints, around its base."""
    engine = world.engine
    links = engine.links(body).values()
    boxes = [engine.box(link) for link in links]
    low, high = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
    if len(links) == 1:
        return low, high
    base = np.array(engine.frame((body, BASE))[0])
    reach = max(np.max(high - base), np.max(base - low))
    return base - reach, base + reach
