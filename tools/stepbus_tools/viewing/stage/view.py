"""What a page of a recording and one of a live run have in common."""

import html
from collections.abc import Callable, Sequence
from typing import Any

from stepbus_schemas import BaseState, GripperState
from stepbus_tools.viewing.scene.bodies import Messages
from stepbus_tools.viewing.scene.build import Ports
from stepbus_tools.viewing.scene.scene import Scene
from stepbus_tools.viewing.stage.curves import Curves, Data, Signal, signals
from stepbus_tools.viewing.stage.overlays import Images, Overlays

from .server import set_theme
from .stage import Stage, look_at

_MOST_EVENTS = 40
_BULKY = ("Image/1", "PointCloud/1", "Chain/1", "CallRecord/1")
_HELD = ("GripperState/1", "BaseState/1")


class View:
    """Scene, cameras, curves and sentences on one page.

    ports: of the recording. sample: returns the data of a signal. tabs: those that all pages have;
    a page may add more.
    """

    def __init__(
        self, server: Any, scene: Scene, ports: Ports, sample: Callable[[Signal], Data]
    ) -> None:
        self._server = server
        self._ports = ports
        self.stage = Stage(server, scene)
        self._overlays = Overlays(server, self.stage, ports)
        self._held = sorted(port.topic for port in ports.values() if port.type in _HELD)
        self.status = server.gui.add_markdown("")
        self.tabs = server.gui.add_tab_group()
        with self.tabs.add_tab("Scene"):
            self._add_scene()
        self.curves = Curves(server, self.tabs.add_tab("Curves"), sample)
        with self.tabs.add_tab("Events"):
            self._events = server.gui.add_html(_list([]))
        self._images = Images(server, ports)
        if self._images.topics:
            self._camera_tab = self.tabs.add_tab("Images")
        self._looked = False

    @property
    def topics(self) -> frozenset[str]:
        """Return the ports that are shown all the time."""
        shown = self._overlays.topics | self._images.topics
        return self.stage.scene.topics | shown | frozenset(self._held)

    def _add_scene(self) -> None:
        gui = self._server.gui
        if self.stage.ghosts:
            ghosts = gui.add_checkbox("targets", initial_value=True)
            ghosts.on_update(lambda _: self.stage.ghosts.show(visible=ghosts.value))
        marks = gui.add_checkbox("contacts, paths, detections", initial_value=True)
        marks.on_update(lambda _: self._overlays.switch(visible=marks.value))
        dark = gui.add_checkbox("dark", initial_value=False)
        dark.on_update(lambda _: set_theme(self._server, is_dark=dark.value))
        self._held_text = gui.add_markdown("")
        if self.stage.scene.notes:
            gui.add_html(_list(self.stage.scene.notes))

    def show(self, messages: Messages) -> None:
        """Show what messages say: of each port the newest one."""
        if not self._looked and messages:
            self._looked = True
            look_at(self._server, self.stage.scene, messages)
        with self._server.atomic():
            self.stage.move(self.stage.scene.poses(messages))
            self._overlays.show(messages)
        if self._images.topics & messages.keys():
            with self._camera_tab:
                self._images.show(messages)
        rows = (_held(topic, messages[topic].message) for topic in self._held if topic in messages)
        held = "  \n".join(rows)
        if held != self._held_text.content:
            self._held_text.content = held

    def offer_signals(self, messages: Messages) -> None:
        """Offer the signals of messages as curves."""
        self.curves.offer(signals(self._ports, messages))

    def tell(self, events: Sequence[str]) -> None:
        """Show the last sentences of a run."""
        self._events.content = _list(events[-_MOST_EVENTS:])


def plain_topics(ports: Ports) -> list[str]:
    """Return the ports that may have curves."""
    return [port.topic for port in ports.values() if port.type not in _BULKY]


def _held(topic: str, message: object) -> str:
    if isinstance(message, GripperState):
        held = f"holds something, {message.force:.1f} N" if message.holding else "holds nothing"
        return f"**{topic}** {held}, {message.width * 1000:.0f} mm open"
    if isinstance(message, BaseState):
        return f"**{topic}** x {message.x:.3f} m, y {message.y:.3f} m, yaw {message.yaw:.3f} rad"
    return ""


def _list(lines: Sequence[str]) -> str:
    """Return sentences as HTML; they come from the author of the recording."""
    rows = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    style = "font-size: 0.8em; padding: 0 0.8em 0 1.8em; overflow-wrap: anywhere"
    return f'<ul style="{style}">{rows or "<li>nothing yet</li>"}</ul>'
