"""What a script draws, on the 3D page."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np


def draw(scene: Any, path: str, message: Any, poses: Mapping[str, Any]) -> Sequence[Any]:
    """Draw all that a `Drawings/1` has.

    scene: of viser. path: below which it is. poses: of all links, by name.
    """
    made, rest = [], np.array(message.points, dtype=np.float32).reshape(-1, 3)
    for number, text in enumerate(message.objects):
        form, *figures, frame = text.split(" ", 6)
        size, *colour, count = map(float, figures)
        points, rest = rest[: int(count)], rest[int(count) :]
        if frame in poses:
            points = np.array([(poses[frame] @ type(poses[frame])(at)).position for at in points])
        name, rgb = f"{path}/{number}", tuple(round(255 * min(max(c, 0.0), 1.0)) for c in colour)
        if form == "points" and count:
            look = {"point_size": max(size, 1e-3), "point_shape": "circle"}
            made.append(scene.add_point_cloud(name, points=points, colors=rgb, **look))
        elif count > 1:
            pairs, width = _ends(form, points), max(size, 1.0)
            made.append(scene.add_line_segments(name, points=pairs, colors=rgb, line_width=width))
    return made


def _ends(form: str, points: Any) -> Any:
    """Return the ends of lines, shape (n, 2, 3): pairs, sides of triangles, or a polyline."""
    if form == "lines":
        return points[: len(points) // 2 * 2].reshape(-1, 2, 3)
    if form == "triangles":
        corners = points[: len(points) // 3 * 3].reshape(-1, 3, 3)
        return np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    return np.stack([points[:-1], points[1:]], axis=1)
