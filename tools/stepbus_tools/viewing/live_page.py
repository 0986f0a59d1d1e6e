"""A run that is going, on a page."""

import math
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stepbus_orchestrator.recording import Tail, layout
from stepbus_schemas import Event
from stepbus_tools.viewing.controls import Controls
from stepbus_tools.viewing.run_client import Link, Turn, follow_run, latest_of
from stepbus_tools.viewing.scene import Messages, build_scene
from stepbus_tools.viewing.stage.stage_view import View, plain_topics
from stepbus_tools.viewing.steer_panel import Points

_CHART_S = 0.25
_WORDS_S = 0.5
_RATE_S = 2.0
_IDLE_S = 5.0


class LivePage:
    """A run on a page: its scene, its curves, its participants, and what can be asked of it.

    server: of viser. tail: of its recording, which has its first messages. link: to the run.
    """

    def __init__(self, server: Any, tail: Tail, link: Link) -> None:
        self._tail = tail
        self._link = link
        self._events: list[str] = []
        self._event_topics = [p.topic for p in tail.ports.values() if p.type == "Event/1"]
        tail.keep(self._event_topics)
        self._controls = Controls(server, link, tail.ports)
        scene = build_scene(tail.path, tail.ports, tail.attachments)
        self._points = Points(tail, plain_topics(tail.ports), lambda: tail.step_ns)
        self._view = View(server, scene, tail.ports, self._points.sample)
        self._controls.add_tabs(self._view.tabs, self._view.stage)
        self._pace: deque[tuple[float, int]] = deque(maxlen=round(_RATE_S / _WORDS_S) + 1)
        self._charted = self._worded = 0.0
        self._grown_at = time.monotonic()

    def turn(self, is_new: bool) -> None:
        """Show what is new."""
        if is_new:
            messages = self._latest(self._view.topics)
            self._view.show(messages)
            self._controls.hands.follow(messages)
            self._points.add()
        now = time.monotonic()
        self._grown_at = now if is_new else self._grown_at
        if now - self._charted >= _CHART_S:
            self._charted = now
            self._view.curves.update()
        if now - self._worded >= _WORDS_S:
            self._worded = now
            self._show_words()

    def _latest(self, topics: Any) -> Messages:
        return latest_of(self._tail, topics)

    def _rate(self) -> float:
        """Return how fast the run went lately, as a factor of real time."""
        status = self._link.status
        if not status or status["phase"] == "paused":
            self._pace.clear()
            return math.nan
        self._pace.append((status["elapsed_s"], status["step"]))
        (began, first), (now, step) = self._pace[0], self._pace[-1]
        simulated_s = (step - first) * status["step_ns"] * 1e-9
        return simulated_s / (now - began) if now > began else math.nan

    # --- words ----------------------------------------------------------------------------

    def _show_words(self) -> None:
        self._view.offer_signals(self._latest(plain_topics(self._tail.ports)))
        words = headline(self._link.status, self._tail.last_step, self._rate())
        idle_s = time.monotonic() - self._grown_at
        if idle_s > _IDLE_S and self._link.status.get("phase") != "paused":
            words += f"  \n**nothing new for {idle_s:.0f} s**"
        self._view.status.content = words
        self._controls.update()
        count = len(self._events)
        for topic in self._event_topics:
            for step, data in self._tail.take_kept(topic):
                message = self._tail.decode(topic, data)
                if isinstance(message, Event):
                    who = layout.split_topic(topic)[0]
                    self._events.append(f"step {step} {message.level}: {who}: {message.text}")
        self._events += self._link.said
        self._link.said = []
        if len(self._events) > count:
            self._view.tell(self._events)


def headline(status: Any, last_step: int, rate: float) -> str:
    """Return how far a run is, in words. rate: factor of real time; NaN while it is unknown."""
    if not status:
        return f"step {last_step}"
    t_s = status["step"] * status["step_ns"] * 1e-9
    total = "" if status["steps"] is None else f" of {status['steps']}"
    factor = "" if math.isnan(rate) else f", {rate:.2f} × real time"
    return f"**{status['phase']}**, t = {t_s:.2f} s, step {status['step']}{total}{factor}"


def follow(server: Any, folder: Path, is_over: Callable[[], bool], start_s: float = 600.0) -> bool:
    """Show a run on a page until it has ended, or the viewer has; returns whether the run has.

    folder, start_s, and what is raised: as of `follow_run`.
    """
    waiting = server.gui.add_markdown("waiting for the run to start …")

    def begin(tail: Tail, link: Link) -> Turn:
        waiting.remove()
        return LivePage(server, tail, link).turn

    return follow_run(folder, is_over, begin, start_s)
