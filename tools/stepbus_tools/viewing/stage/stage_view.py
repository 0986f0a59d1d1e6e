"""What a page of a recording and one of a live run have in common."""

import html
from collections.abc import Callable, Sequence
from typing import Any

from stepbus_schemas import BaseState, GripperState
from stepbus_tools.viewing.scene import Messages, Ports, Scene, recorded_topics
from stepbus_tools.viewing.stage.camera import look_at
from stepbus_tools.viewing.stage.overlays import Images, Overlays
from stepbus_tools.viewing.stage.stage_curves import Curves, Data, Signal, signals

from .stage import Stage

_MOST_EVENTS = 40
_BULKY = ("Image/1", "PointCloud/1", "Chain/1")


class View:
    """Scene, cameras, curves and sentences on one page.

    ports: of the recording. sample: returns the data of a signal. tabs: what the page adds above
    the tabs that all pages have.
    """

    def __init__(
        self, server: Any, scene: Scene, ports: Ports, sample: Callable[[Signal], Data]
    ) -> None:
        self._server = server
        self.stage = Stage(server, scene)
        self._ports = ports
        self._overlays = Overlays(server, self.stage, ports)
        self._names = {port.topic: port.names for port in ports.values()}
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
        return self.stage.scene.topics | self._overlays.topics | self._images.topics | self._held

    @property
    def _held(self) -> frozenset[str]:
        kinds = ("GripperState/1", "BaseState/1")
        return frozenset(port.topic for port in self._ports.values() if port.type in kinds)

    def _add_scene(self) -> None:
        gui = self._server.gui
        if self.stage.has_ghosts:
            ghosts = gui.add_checkbox("targets", initial_value=True)
            ghosts.on_update(lambda _: self.stage.show_ghosts(visible=ghosts.value))
        marks = gui.add_checkbox("contacts, paths, detections", initial_value=True)
        marks.on_update(lambda _: self._overlays.switch(visible=marks.value))
        dark = gui.add_checkbox("dark", initial_value=False)
        dark.on_update(lambda _: self._darken(is_dark=dark.value))
        self.held = gui.add_markdown("")
        if self.stage.scene.notes:
            gui.add_html(_list(self.stage.scene.notes))

    def _darken(self, *, is_dark: bool) -> None:
        self._server.gui.configure_theme(
            control_width="large", show_logo=False, show_share_button=False, dark_mode=is_dark
        )

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
        held = "  \n".join(_held(topic, messages) for topic in sorted(self._held & messages.keys()))
        if held != self.held.content:
            self.held.content = held

    def offer_signals(self, messages: Messages) -> None:
        """Offer the signals of messages as curves."""
        plain = {topic: messages[topic] for topic in plain_topics(self._ports) if topic in messages}
        self.curves.offer(signals(plain, self._names))

    def tell(self, events: Sequence[str]) -> None:
        """Show the last sentences of a run."""
        self._events.content = _list(events[-_MOST_EVENTS:])


def plain_topics(ports: Ports) -> list[str]:
    """Return the ports that may have curves."""
    return [topic for topic in recorded_topics(list(ports)) if ports[topic].type not in _BULKY]


def _held(topic: str, messages: Messages) -> str:
    message = messages[topic].message
    if isinstance(message, GripperState):
        held = f"holds something, {message.force:.1f} N" if message.holding else "holds nothing"
        return f"**{topic}** {held}, {message.width * 1000:.0f} mm open"
    if isinstance(message, BaseState):
        return f"**{topic}** x {message.x:.3f} m, y {message.y:.3f} m, yaw {message.yaw:.3f} rad"
    return ""


def _list(lines: Sequence[str]) -> str:
    """Return sentences as HTML; they are of whoever made the recording."""
    rows = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    style = "font-size: 0.8em; padding: 0 0.8em 0 1.8em; overflow-wrap: anywhere"
    return f'<ul style="{style}">{rows or "<li>nothing yet</li>"}</ul>'
