"""Where a viewer stands at the start: so that all that moves is seen."""

from typing import Any

import numpy as np

from stepbus_tools.viewing.scene import Messages, Scene

_AWAY = np.array([0.64, -0.64, 0.43])
_RIGHT = 0.14 * np.array([1.0, 1.0, 0.0])
"""The controls cover the right of the page, so its middle is to the right of the scene's."""
_FLAT, _TALL = 0.6, 0.25
"""How far away, in sizes of a scene: one that is flat needs less of the page."""
_FLOOR_M = 8.0
_FEW = 40
_NARROW, _LIFT = 0.7, 0.3
"""On a page that is higher than wide: how far away at an aspect of 1, how far below the middle."""
_APART = (4.0, 96.0)
"""What is outside of these percentiles, such as a crate in a far corner, does not count."""


def bounds(scene: Scene, messages: Messages) -> tuple[Any, Any]:
    """Return the lower and upper corner of what a scene shows, shape (3,) [m].

    Things over 8 m in size, such as a floor, do not count.
    """
    corners = []
    poses = scene.world_poses(messages)
    for frame in scene.frames:
        for visual in frame.visuals:
            vertices = visual.mesh.vertices
            low, high = vertices.min(axis=0), vertices.max(axis=0)
            if float(np.max(high - low)) < _FLOOR_M:
                x, y, z = ((low + high) / 2).tolist()
                placed = poses[frame.name] @ visual.pose
                middle = np.array((placed @ type(placed)((x, y, z))).position)
                reach = float(np.linalg.norm(high - low)) / 2
                corners += [middle - reach, middle + reach]
    if not corners:
        return np.full(3, -1.0), np.full(3, 1.0)
    if len(corners) < _FEW:
        return np.min(corners, axis=0), np.max(corners, axis=0)
    low, high = np.percentile(corners, _APART, axis=0)
    return low, high


def _step_back(client: Any, middle: Any, away: float) -> None:
    """Let the scene fit above the controls of a page that is higher than wide, as on a phone."""
    aspect = client.camera.aspect
    if aspect >= 1.0:
        return
    distance = away * _NARROW / aspect
    down = np.array([0.0, 0.0, _LIFT * distance])
    with client.atomic():
        client.camera.position = tuple((middle + _AWAY * distance - down).tolist())
        client.camera.look_at = tuple((middle - down).tolist())


def look_at(server: Any, scene: Scene, messages: Messages) -> None:
    """Let new viewers look at the whole scene, and draw a floor below it."""
    low, high = bounds(scene, messages)
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    camera = server.initial_camera
    width, depth, height = (high - low).tolist()
    away = (_FLAT + _TALL * min(1.0, height / max(width, depth, 1e-9))) * size
    beside = middle + _RIGHT * away
    camera.look_at = tuple(beside.tolist())
    camera.position = tuple((beside + _AWAY * away).tolist())
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
