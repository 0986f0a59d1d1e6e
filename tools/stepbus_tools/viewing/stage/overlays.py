"""What a page shows beside the frames of a scene: camera images, contacts, plans, detections."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from stepbus_orchestrator.plugins import OVERLAYS, points
from stepbus_schemas import Contacts, Detections, Image, Plan
from stepbus_tools.viewing.rasteriser import pixels_of
from stepbus_tools.viewing.scene.build import Ports
from stepbus_tools.viewing.scene.pose import Pose
from stepbus_tools.viewing.scene.scene import Messages
from stepbus_tools.viewing.stage.stage import Stage

_CONTACT: tuple[int, int, int] = (230, 30, 30)
_PATH: tuple[int, int, int] = (20, 160, 60)
_SEEN: tuple[int, int, int] = (250, 180, 0)
_METRES_PER_LOG_N = 0.08
_MOST_POINTS = 60


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
            if latest.step == step or not isinstance(latest.message, Image):
                continue
            try:
                pixels = pixels_of(latest.message)
            except ValueError:
                continue
            if not pixels.size:
                continue
            if handle is None:
                handle = self._gui.add_image(pixels, label=topic, jpeg_quality=80)
            else:
                handle.image = pixels
            self._shown[topic] = (latest.step, handle)


Past = Callable[[int], Messages]


class Overlays:
    """Draws contacts, detections and planned paths when they change."""

    def __init__(self, server: Any, stage: Stage, ports: Ports) -> None:
        self._scene = server.scene
        self._stage = stage
        self._chains = {chain.topic: chain for chain in stage.scene.chains}
        self._drawn: dict[str, tuple[int, Sequence[Any]]] = {}
        self._visible = True
        drawers: Mapping[str, Callable[[str, Any, Messages], Sequence[Any]]] = {
            "Contacts/1": self._contacts,
            "Detections/1": self._detections,
            "Plan/1": self._plan,
            **{point.name: partial(self._other, point.load()) for point in points(OVERLAYS)},
        }
        self._drawers = {
            port.topic: drawers[port.type] for port in ports.values() if port.type in drawers
        }
        self.topics = frozenset(self._drawers)

    def show(self, messages: Messages, past: Past | None = None) -> None:
        """Draw what is new. past: returns the messages of an earlier step; None: they are these."""
        for topic, draw in self._drawers.items():
            latest = messages.get(topic)
            step, handles = self._drawn.get(topic, (-1, ()))
            now = -1 if latest is None else latest.step
            if now != step:
                for handle in handles:
                    handle.remove()
                then = past(now) if past is not None and latest is not None else messages
                made = [] if latest is None else draw(topic, latest.message, then)
                self._drawn[topic] = (now, made)
                self.switch(visible=self._visible)

    def switch(self, *, visible: bool) -> None:
        """Show or hide all of it."""
        self._visible = visible
        for handle in chain.from_iterable(handles for _, handles in self._drawn.values()):
            if handle.visible != visible:
                handle.visible = visible

    def _contacts(self, topic: str, contacts: Contacts, _: Messages) -> Sequence[Any]:
        """Draw an arrow on each point that is pressed on; its length grows with the force."""
        rows = zip(contacts.position, contacts.peaks, strict=False)
        points = [
            [(x, y, z + _METRES_PER_LOG_N * math.log1p(force)), (x, y, z)]
            for (x, y, z), force in rows
            if force > 0 and all(map(math.isfinite, (x, y, z)))
        ]
        if not points:
            return []
        sizes = {"shaft_radius": 0.006, "head_radius": 0.015, "head_length": 0.03}
        shown = np.array(points)
        return [self._scene.add_arrows(_path(topic), points=shown, colors=_CONTACT, **sizes)]

    def _plan(self, topic: str, plan: Plan, _: Messages) -> Sequence[Any]:
        """Draw the path of the last link that a plan moves."""
        chain = self._chains.get(topic)
        last = len(plan.position) - 1
        if chain is None or last < 1:
            return []
        count = min(_MOST_POINTS, last)
        rows = (plan.position[number * last // count] for number in range(count + 1))
        joints = (dict(zip(chain.names, row, strict=False)) for row in rows)
        points = np.array([chain.model.pose(chain.tip, joint).position for joint in joints])
        # It is of the joints, so it moves with the base.
        path = f"{self._stage.paths[chain.root]}/plan"
        segments = np.stack([points[:-1], points[1:]], axis=1)
        return [self._scene.add_line_segments(path, points=segments, colors=_PATH, line_width=4.0)]

    def _detections(self, topic: str, seen: Detections, messages: Messages) -> Sequence[Any]:
        """Draw a point for each item that was seen."""
        frame = self._stage.scene.world_poses(messages).get(seen.frame, Pose())
        return [
            self._scene.add_icosphere(
                f"{_path(topic)}/{number}",
                radius=0.012,
                color=_SEEN,
                position=(frame @ Pose(at)).position,
            )
            for number, at in enumerate(seen.position)
        ]

    def _other(self, draw: Any, topic: str, message: Any, messages: Messages) -> Sequence[Any]:
        """Let another package draw a message of its own type."""
        poses = self._stage.scene.world_poses(messages)
        handles: Sequence[Any] = draw(self._scene, _path(topic), message, poses)
        return handles


def _path(topic: str) -> str:
    return f"/shown/{topic.replace('/', '.')}"
