"""The common part of the pages of a recording and of a live run."""

import html
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from stepbus_orchestrator.run.result import Result
from stepbus_schemas import BaseState, Detections, EmergencyStop, GripperState
from stepbus_tools.report.charts import Mark
from stepbus_tools.viewing.scene.build import Ports
from stepbus_tools.viewing.scene.scene import Messages, Scene
from stepbus_tools.viewing.stage.chart_tab import Curves, Data, Signal, signals
from stepbus_tools.viewing.stage.overlays import Images, Overlays, Past
from stepbus_tools.viewing.stage.stage import Stage

_MOST_EVENTS = 40
_BULKY = ("Image/1", "PointCloud/1", "Chain/1", "CallRecord/1")
_HELD = ("GripperState/1", "BaseState/1", "EmergencyStop/1", "Detections/1")


class View:
    """Scene, cameras, curves and sentences on one page.

    server: of viser. ports: of the recording. sample: returns the data of a signal. runs: names of
    two recordings whose data that is, else none. tabs: those that all pages have; a page may add
    more. stopped: who stopped the robot, and when; empty while nobody has.
    """

    def __init__(
        self,
        server: Any,
        scene: Scene,
        ports: Ports,
        sample: Callable[[Signal], Data],
        runs: Sequence[str] = (),
    ) -> None:
        self._server = server
        self._ports = ports
        self.stopped = ""
        self.stage = Stage(server, scene)
        self._overlays = Overlays(server, self.stage, ports)
        self._held = sorted(port.topic for port in ports.values() if port.type in _HELD)
        self.status = server.gui.add_markdown("")
        if runs:
            server.gui.add_html(_legend(*runs))
        self.tabs = server.gui.add_tab_group()
        with self.tabs.add_tab("Scene"):
            self._add_scene()
        self.curves = Curves(server.gui, self.tabs.add_tab("Curves"), sample, runs)
        with self.tabs.add_tab("Events"):
            self._events = server.gui.add_html(listed([], 0))
        self._images = Images(server, ports)
        if self._images.topics:
            self._camera_tab = self.tabs.add_tab("Images")

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
        if self._overlays.topics:
            marks = gui.add_checkbox("contacts, paths, detections", initial_value=True)
            marks.on_update(lambda _: self._overlays.switch(visible=marks.value))
        self._held_text = gui.add_markdown("")
        if self.stage.scene.notes:
            rows = "".join(f"<li>{html.escape(note)}</li>" for note in self.stage.scene.notes)
            gui.add_html(f'<ul class="lines">{rows}</ul>')

    def show(self, messages: Messages, past: Past | None = None) -> None:
        """Show the newest message of each port. past: as of `Overlays.show`."""
        with self._server.atomic():
            self.stage.move(self.stage.scene.poses(messages))
            self._overlays.show(messages, past)
        if self._images.topics & messages.keys():
            with self._camera_tab:
                self._images.show(messages)
        held = [messages[topic].message for topic in self._held if topic in messages]
        self.stopped = next(
            (
                f"by {one.by or 'the scenario'}, since t = {one.since:.2f} s"
                for one in held
                if isinstance(one, EmergencyStop) and one.active
            ),
            "",
        )
        rows = (_held(topic, messages[topic].message) for topic in self._held if topic in messages)
        text = "  \n".join(filter(None, rows))
        if text != self._held_text.content:
            self._held_text.content = text

    def offer_signals(self, messages: Messages) -> None:
        """Offer the signals of messages as curves."""
        self.curves.offer(signals(self._ports, messages))

    def tell(self, marks: Sequence[Mark]) -> None:
        """Show the last sentences of a run."""
        content = listed(marks, _MOST_EVENTS)
        if content != self._events.content:
            self._events.content = content


def stop_banner(stopped: str) -> str:
    """Return the banner of an emergency stop, as HTML; empty if not stopped."""
    if not stopped:
        return ""
    return f'<div class="stopped" role="alert"><b>Emergency stop</b>{html.escape(stopped)}</div>'


def _legend(run: str, ghost: str) -> str:
    """Return which of two recordings is which, in the scene and in the curves, as HTML."""
    return (
        f'<div class="runs"><div><i></i><b>{html.escape(run)}</b> · solid body, solid lines</div>'
        f'<div><i class="ghost"></i><b>{html.escape(ghost)}</b> · ghost, dashed lines</div></div>'
    )


def plain_topics(ports: Ports) -> list[str]:
    """Return the ports that may have curves."""
    return [port.topic for port in ports.values() if port.type not in _BULKY]


def _held(topic: str, message: object) -> str:
    if isinstance(message, GripperState):
        held = f"holding an object, {message.force:.1f} N" if message.holding else "empty"
        return f"**{topic}** {held}, {message.width * 1000:.0f} mm open"
    if isinstance(message, BaseState):
        return f"**{topic}** x {message.x:z.3f} m, y {message.y:z.3f} m, yaw {message.yaw:z.3f} rad"
    if isinstance(message, Detections):
        counts = Counter(message.types)
        seen = ", ".join(f"{count} × {kind}" for kind, count in sorted(counts.items()))
        return f"**{topic}** {seen or 'nothing detected'}"
    return ""


def listed(marks: Sequence[Mark], most: int) -> str:
    """Return the last marks as HTML; their text comes from the author of the recording."""
    rows = "".join(
        f'<li data-level="{html.escape(mark.level)}">{html.escape(mark.label)}</li>'
        for mark in marks[-most:]
    )
    return f'<ul class="lines">{rows or "<li>nothing yet</li>"}</ul>'


def failure_banner(result: Result | None, run: str = "") -> str:
    """Return the banner of a failed run with its reason, as HTML; else empty. run: its name."""
    if result is None or not result.exit_code:
        return ""
    who, why = html.escape(f"{run} failed".strip()), html.escape(result.cause or result.reason)
    return f'<div class="failed" role="alert"><b>{who}</b>: {why}</div>'
