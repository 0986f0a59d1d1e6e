"""Pictures of a simulation in this process: PyBullet's TinyRenderer, loaded when first needed."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_schemas import RunError

_MOST_CLIENTS = 1024
_FIELD_OF_VIEW = 45.0
_NEAR, _FAR = 0.05, 200.0
_LARGEST = 50.0


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
    """Takes pictures of what one run simulates with PyBullet in this process."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._client: int | None = None
        self._view: Any = None

    @contextlib.contextmanager
    def watching(self) -> Iterator[None]:
        """Find the simulation that starts meanwhile."""
        before = _clients()
        yield
        # The first that holds bodies is the plant's; others are models of a planner, say.
        self._client = next((n for n in _clients() - before if _bodies(n)), None)

    def frame(self) -> NDArray[np.uint8]:
        """Return a picture, shape (height, width, 3); raises RunError where there is none."""
        if self._client is None:
            raise RunError("no participant of this scenario simulates with PyBullet: no pictures")
        bullet = sys.modules["pybullet"]
        camera, client = self._camera, self._client
        if self._view is None:
            self._view = _view(bullet, camera, client)
        projection = bullet.computeProjectionMatrixFOV(
            _FIELD_OF_VIEW, camera.width / camera.height, _NEAR, _FAR
        )
        _, _, rgba, *_ = bullet.getCameraImage(
            camera.width,
            camera.height,
            self._view,
            projection,
            renderer=bullet.ER_TINY_RENDERER,
            physicsClientId=client,
        )
        pixels = np.asarray(rgba, dtype=np.uint8).reshape(camera.height, camera.width, 4)
        return pixels[:, :, :3].copy()


def _clients() -> set[int]:
    """Return the simulations of this process."""
    bullet = sys.modules.get("pybullet")
    if bullet is None:
        return set()
    return {n for n in range(_MOST_CLIENTS) if bullet.isConnected(n)}


def _bodies(client: int) -> list[int]:
    bullet = sys.modules["pybullet"]
    count = bullet.getNumBodies(physicsClientId=client)
    return [bullet.getBodyUniqueId(n, physicsClientId=client) for n in range(count)]


def _view(bullet: Any, camera: Camera, client: int) -> Any:
    """Return the view of all bodies, wherever their joints take them."""
    boxes = [_reach(bullet, body, client) for body in _bodies(client)]
    # A floor without an end is no part of the picture.
    boxes = [box for box in boxes if np.max(box[1] - box[0]) < _LARGEST] or boxes
    low, high = np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)
    target = camera.target or tuple((low + high) / 2)
    half_angle = np.radians(_FIELD_OF_VIEW / 2)
    distance = camera.distance or 1.1 * float(np.max(high - low)) / 2 / np.tan(half_angle)
    return bullet.computeViewMatrixFromYawPitchRoll(
        target, distance, camera.yaw, camera.pitch, 0, 2
    )


def _reach(bullet: Any, body: int, client: int) -> tuple[Any, Any]:
    """Return the corners of what a body occupies; of one with joints, around its base."""
    joints = bullet.getNumJoints(body, physicsClientId=client)
    boxes = [bullet.getAABB(body, link, physicsClientId=client) for link in range(-1, joints)]
    low, high = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
    if not joints:
        return low, high
    base = np.array(bullet.getBasePositionAndOrientation(body, physicsClientId=client)[0])
    reach = max(np.max(high - base), np.max(base - low))
    return base - reach, base + reach
