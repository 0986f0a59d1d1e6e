"""Where visitors stand: their cameras show all that moves, clear of the controls, until moved."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_tools.viewing.scene.swept import Box, apart
from stepbus_tools.viewing.stage.stage import add_floor
from stepbus_tools.viewing.viewpoint import MARGIN as _MARGIN
from stepbus_tools.viewing.viewpoint import Part, framed, size_of

_PANEL_PX = 420
"""Of the controls, at the right of a page, with their margin."""
_COVERED = 0.5
"""Of a page that is higher than wide: the controls cover as much, from below (front.css)."""
_GREW = 0.05
_SAME = 1e-3


class Framing:
    """Keeps a box in the pictures of all visitors who have not moved their camera.

    server: of viser.
    """

    def __init__(self, server: Any) -> None:
        self._server = server
        self._floor: Box | None = None
        self._views: dict[int, _Camera] = {}

    def turn(self, box: Box, fixed: NDArray[np.float64]) -> None:
        """Place the cameras of those who have come, whose page or whose box has grown.

        box, fixed: of `Swept`.
        """
        clients = self._server.get_clients()
        self._views = {key: self._views.get(key) or _Camera() for key in clients}
        for key, client in clients.items():
            self._views[key].turn(client, box, fixed)
        if self._floor is None or apart(box, self._floor) > size_of(self._floor):
            self._floor = box
            add_floor(self._server.scene, *box)


class _Camera:
    """The camera of one visitor."""

    def __init__(self) -> None:
        self._ours: list[NDArray[np.float64]] = []
        self._box: Box | None = None
        self._size = (0, 0)

    def turn(self, client: Any, box: Box, fixed: NDArray[np.float64]) -> None:
        camera = client.camera
        size = (camera.image_width, camera.image_height)
        has_grown = self._box is None or apart(box, self._box) > _GREW * size_of(box)
        if (size == self._size and not has_grown) or self._is_moved(camera.position, size_of(box)):
            return
        self._box, self._size = box, size
        aspect = size[0] / max(1, size[1])
        view = framed(box, fixed=fixed, aspect=aspect, fov=camera.fov, free=free_part(*size))
        # It may still report where it was before.
        self._ours += [np.array(camera.position), view.eye] if not self._ours else [view.eye]
        with client.atomic():
            camera.position = tuple(view.eye.tolist())
            camera.look_at = tuple(view.target.tolist())

    def _is_moved(self, position: Any, size: float) -> bool:
        rows = [float(np.linalg.norm(position - ours)) for ours in self._ours]
        return bool(rows) and min(rows) > _SAME * max(1.0, size)


def free_part(width: int, height: int) -> Part:
    """Return what the controls leave free of a page."""
    if width < height:
        return (-_MARGIN, _MARGIN), (2 * _COVERED - 1 + (1 - _MARGIN), _MARGIN)
    right = max(0.0, 1 - 2 * _PANEL_PX / max(1, width))
    return (-_MARGIN, right - (1 - _MARGIN) / 2), (-_MARGIN, _MARGIN)
