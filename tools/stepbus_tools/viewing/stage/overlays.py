"""Camera images as a page shows them."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from stepbus_schemas import Contacts, Detections, Image, Message, Plan
from stepbus_tools.viewing.render import pixels_of
from stepbus_tools.viewing.scene import Chain, Messages, Ports, Pose
from stepbus_tools.viewing.stage.stage import Stage


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


_CONTACT: tuple[int, int, int] = (230, 30, 30)
_PATH: tuple[int, int, int] = (20, 160, 60)
_SEEN: tuple[int, int, int] = (250, 180, 0)
_METRES_PER_LOG_N = 0.08
_MOST_POINTS = 60
_ROOT = "/shown"


class Overlays:
    """Draws what messages of some types say beside the frames, when they change."""

    def __init__(self, server: Any, stage: Stage, ports: Ports) -> None:
        self._server = server
        self._stage = stage
        self._scene = scene = stage.scene
        self._chains = {chain.topic: chain for chain in scene.chains}
        self._drawn: dict[str, tuple[int, Any]] = {}
        self._visible = True
        drawers = {
            "Contacts/1": self._contacts,
            "Detections/1": self._detections,
            "Plan/1": self._plan,
        }
        self._drawers: Mapping[str, Callable[[str, Message, Messages], Sequence[Any]]] = {
            port.topic: drawers[port.type] for port in ports.values() if port.type in drawers
        }

    @property
    def topics(self) -> frozenset[str]:
        """Return the ports that it draws."""
        return frozenset(self._drawers)

    def show(self, messages: Messages) -> None:
        """Draw what is new."""
        for topic, draw in self._drawers.items():
            latest = messages.get(topic)
            step, handles = self._drawn.get(topic, (-1, ()))
            now = -1 if latest is None else latest.step
            if now != step:
                for handle in handles:
                    handle.remove()
                made = [] if latest is None else draw(_path(topic), latest.message, messages)
                self._drawn[topic] = (now, made)
                self._apply(made)

    def switch(self, *, visible: bool) -> None:
        """Show or hide all of it."""
        self._visible = visible
        for _, handles in self._drawn.values():
            self._apply(handles)

    def _apply(self, handles: Sequence[Any]) -> None:
        for handle in handles:
            if not self._visible or not handle.visible:
                handle.visible = self._visible

    def _contacts(self, path: str, message: Message, _: Messages) -> Sequence[Any]:
        """Draw an arrow on each point that is pressed on; its length grows with the force."""
        if not isinstance(message, Contacts):
            return []
        rows = zip(message.position, message.force, strict=False)
        pressed = [(at, force) for at, force in rows if force > 0 and all(map(math.isfinite, at))]
        if not pressed:
            return []
        points = np.array(
            [[(x, y, z + _METRES_PER_LOG_N * math.log1p(f)), (x, y, z)] for (x, y, z), f in pressed]
        )
        scene = self._server.scene
        sizes = {"shaft_radius": 0.006, "head_radius": 0.015, "head_length": 0.03}
        return [scene.add_arrows(path, points=points, colors=_CONTACT, **sizes)]

    def _plan(self, path: str, message: Message, _: Messages) -> Sequence[Any]:
        """Draw the path of the last link that a plan moves."""
        chain = self._chains.get(next((t for t in self._chains if _path(t) == path), ""))
        if chain is None or not isinstance(message, Plan) or len(message.position) < 2:
            return []
        points = np.array([_tip(chain, row).position for row in _thinned(message)])
        segments = np.stack([points[:-1], points[1:]], axis=1)
        # It is of the joints, so it moves with the base.
        line = self._server.scene.add_line_segments(
            f"{self._stage.paths[chain.root]}/plan", points=segments, colors=_PATH, line_width=4.0
        )
        return [line]

    def _detections(self, path: str, message: Message, messages: Messages) -> Sequence[Any]:
        """Draw a point and the type of each item that was seen."""
        if not isinstance(message, Detections) or not message.position:
            return []
        frame = self._scene.world_poses(messages).get(message.frame, Pose())
        scene, made = self._server.scene, []
        for number, at in enumerate(message.position):
            where = (frame @ Pose(at)).position
            name = f"{path}/{number}"
            made.append(scene.add_icosphere(name, radius=0.012, color=_SEEN, position=where))
            # It goes with the point that it is below of.
            scene.add_label(
                f"{name}/type",
                message.types[number],
                font_size_mode="scene",
                font_scene_height=0.03,
            )
        return made


def _tip(chain: Chain, values: Sequence[float]) -> Pose:
    return chain.model.pose(chain.tip, dict(zip(chain.names, values, strict=False)))


def _thinned(plan: Plan) -> Sequence[Sequence[float]]:
    last = len(plan.position) - 1
    count = min(_MOST_POINTS, last)
    return [plan.position[number * last // count] for number in range(count + 1)]


def _path(topic: str) -> str:
    return f"{_ROOT}/{topic.replace('/', '.')}"
