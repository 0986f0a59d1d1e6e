"""Camera images as a page shows them."""

from typing import Any

from stepbus_schemas import Image
from stepbus_tools.viewing.render import pixels_of
from stepbus_tools.viewing.scene import Messages, Ports


class Images:
    """Shows the newest image of each camera."""

    def __init__(self, server: Any, ports: Ports) -> None:
        self._gui = server.gui
        self._order = [port.topic for port in ports.values() if port.type == "Image/1"]
        self.topics = frozenset(self._order)
        self._shown: dict[str, tuple[int, Any]] = {}

    def show(self, messages: Messages) -> None:
        """Show what is new; an image whose bytes do not fit its size is left out."""
        for topic in (name for name in self._order if name in messages):
            latest = messages[topic]
            step, handle = self._shown.get(topic, (-1, None))
            image = latest.message
            if latest.step == step or not isinstance(image, Image):
                continue
            try:
                pixels = pixels_of(image)
            except ValueError:
                continue
            if not pixels.size:
                continue
            if handle is None:
                handle = self._gui.add_image(pixels, label=topic, jpeg_quality=80)
            else:
                handle.image = pixels
            self._shown[topic] = (latest.step, handle)
