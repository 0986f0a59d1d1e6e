"""A run that is going, on a page."""

import math
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Tail, layout
from stepbus_orchestrator.viewing.scene import Latest, Messages, build_scene
from stepbus_orchestrator.viewing.stage.view import View, plain_topics
from stepbus_schemas import Event

from .controls import Controls
from .link import Link
from .points import Points

FRAME_S = 1 / 30
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
        self._step_ns = 0
        self._has_shown = False
        self._events: list[str] = []
        self._event_topics = [p.topic for p in tail.ports.values() if p.type == "Event/1"]
        tail.keep(self._event_topics)
        self._controls = Controls(server, link, tail.ports)
        scene = build_scene(tail.path, tail.ports, tail.attachments)
        self._points = Points(tail, plain_topics(tail.ports), lambda: self._step_ns)
        self._view = View(server, scene, tail.ports, self._points.sample)
        self._controls.add_tabs(self._view.tabs, self._view.stage)
        self._pace: deque[tuple[float, int]] = deque(maxlen=round(_RATE_S / _WORDS_S) + 1)
        self._charted = self._worded = 0.0
        self._grown_at = time.monotonic()

    @property
    def idle_s(self) -> float:
        """Return for how long nothing new has been recorded [s]."""
        return time.monotonic() - self._grown_at

    def turn(self) -> None:
        """Show what is new."""
        # What was there before the page is new to it, also when the run is paused.
        is_new = self._tail.poll() or not self._has_shown
        self._step_ns = self._link.status.get("step_ns", 0) or self._step_ns
        if is_new:
            self._has_shown = True
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
        found = {topic: self._tail.latest(topic) for topic in topics}
        return {t: Latest(step=row[0], message=row[1]) for t, row in found.items() if row}

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
        self._view.status.content = headline(self._link.status, self._tail.last_step, self._rate())
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
    """Show a run until it has ended, or the viewer has; returns whether the run has ended.

    folder: of the run, which may not have begun. start_s: how long to wait for that [s].
    Raises RecordingFailed when it does not begin.
    """
    waiting = server.gui.add_markdown("waiting for the run to start …")
    tail = _wait_for(folder, is_over, start_s)
    if tail is None:
        return False
    link = Link(folder)
    try:
        waiting.remove()
        page = LivePage(server, tail, link)
        while not is_over() and not tail.is_complete:
            began = time.monotonic()
            page.turn()
            if link.is_lost and link.status and page.idle_s > _IDLE_S:
                # It was killed: what it has recorded is shown.
                break
            time.sleep(max(0.0, FRAME_S - (time.monotonic() - began)))
        page.turn()
        return not is_over()
    finally:
        link.close()
        tail.close()


def _wait_for(folder: Path, is_over: Callable[[], bool], start_s: float) -> Tail | None:
    """Return the recording of a run as soon as it has messages; None when the viewer has ended."""
    deadline, path, tail = time.monotonic() + start_s, folder / layout.RUN_FILE, None
    while not is_over():
        if tail is None and path.exists():
            tail = Tail(path)
        if tail is not None and tail.poll() and tail.last_step >= 0:
            return tail
        if tail is not None and tail.is_complete:
            tail.close()
            raise RecordingFailed(f"{path} has no messages, so there is nothing to show")
        if time.monotonic() > deadline:
            raise RecordingFailed(f"{folder}: no run has started there for {start_s:.0f} s")
        time.sleep(FRAME_S)
    if tail is not None:
        tail.close()
    return None
