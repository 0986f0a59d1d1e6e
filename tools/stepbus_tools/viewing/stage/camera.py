"""Where a viewer stands at the start: so that all that moves is seen."""

from typing import Any

import numpy as np

from stepbus_tools.viewing.scene import Messages, Scene, bounds

_AWAY = np.array([0.64, -0.64, 0.43])
_RIGHT = 0.14 * np.array([1.0, 1.0, 0.0])
"""The controls cover the right of the page, so its middle is to the right of the scene's."""
_FLAT, _TALL = 0.6, 0.25
"""How far away, in sizes of a scene: one that is flat needs less of the page."""
_NARROW, _LIFT = 0.7, 0.3
"""On a page that is higher than wide: how far away at an aspect of 1, how far below the middle."""


def look_at(server: Any, scene: Scene, messages: Messages) -> None:
    """Make new viewers look at the whole scene, and draw a floor below it."""
    low, high = bounds(scene, messages)
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    width, depth, height = (high - low).tolist()
    away = (_FLAT + _TALL * min(1.0, height / max(width, depth, 1e-9))) * size
    beside = middle + _RIGHT * away
    server.initial_camera.look_at = tuple(beside.tolist())
    server.initial_camera.position = tuple((beside + _AWAY * away).tolist())
    server.on_client_connect(lambda client: _step_back(client, middle, away))
    side = max(3.0, np.ceil(1.5 * size))
    server.scene.add_grid(
        "/floor",
        width=side,
        height=side,
        position=(float(middle[0]), float(middle[1]), min(0.0, float(low[2]))),
        cell_size=0.5,
        section_size=1.0,
    )


def _step_back(client: Any, middle: Any, away: float) -> None:
    """Fit the scene above the controls of a page that is higher than wide, as on a phone."""
    aspect = client.camera.aspect
    if aspect >= 1.0:
        return
    distance = away * _NARROW / aspect
    down = np.array([0.0, 0.0, _LIFT * distance])
    with client.atomic():
        client.camera.position = tuple((middle + _AWAY * distance - down).tolist())
        client.camera.look_at = tuple((middle - down).tolist())
