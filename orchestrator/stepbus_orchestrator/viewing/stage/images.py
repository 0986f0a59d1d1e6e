"""Camera images as a page shows them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.viewing.scene import Messages, Ports
from stepbus_schemas import Image

_APART = (2.0, 98.0)
_LEAST_M = 0.05
"""A depth image spans from black to white what it sees, but at least so much [m]."""


class Images:
    """Shows the newest image of each camera."""

    def __init__(self, server: Any, ports: Ports) -> None:
        self._gui = server.gui
        self._order = [port.topic for port in ports.values() if port.type == "Image/1"]
        self.topics = frozenset(self._order)
        self._shown: dict[str, tuple[int, Any]] = {}

    def show(self, messages: Messages) -> None:
        """Show what is new."""
        for topic in (name for name in self._order if name in messages):
            latest = messages[topic]
            step, handle = self._shown.get(topic, (-1, None))
            pixels = pixels_of(latest.message) if latest.step != step else None
            if pixels is None:
                continue
            if handle is None:
                handle = self._gui.add_image(pixels, label=topic, jpeg_quality=80)
            else:
                handle.image = pixels
            self._shown[topic] = (latest.step, handle)


def pixels_of(message: object) -> NDArray[np.uint8] | None:
    """Return an image, shape (height, width, 3); depth is darker the nearer it is.

    None for a message whose bytes do not fit its size.
    """
    if not isinstance(message, Image) or not message.width or not message.height:
        return None
    size = (message.height, message.width)
    if message.encoding == "rgb8":
        data = np.frombuffer(message.data, dtype=np.uint8)
        return data.reshape(*size, 3) if data.size == size[0] * size[1] * 3 else None
    if len(message.data) != size[0] * size[1] * 4:
        return None
    depth = np.frombuffer(message.data, dtype="<f4").reshape(size)
    known = depth[np.isfinite(depth) & (depth > 0)]
    near, far = np.percentile(known, _APART) if known.size else (0.0, 1.0)
    reach = np.clip((depth - near) / max(float(far - near), _LEAST_M), 0.0, 1.0)
    grey = np.nan_to_num(reach, nan=1.0) * 255
    return np.repeat(grey.astype(np.uint8)[:, :, None], 3, axis=2)
