"""A live run, on a page."""

import contextlib
import math
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording, Tail, layout
from stepbus_orchestrator.run.live_file import LIVE_FILE
from stepbus_orchestrator.run.result import Result, result_beside
from stepbus_schemas import CallRecord, Decoder, StepbusError
from stepbus_tools.report.charts import Mark
from stepbus_tools.report.summary import scenario_name
from stepbus_tools.viewing.controls import Controls
from stepbus_tools.viewing.history import EVENT_TYPES, mark_of, stop_of
from stepbus_tools.viewing.run_client import FRAME_S, RunClient
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.scene.scene import Latest, Messages
from stepbus_tools.viewing.stage.chart_tab import Data, Signal
from stepbus_tools.viewing.stage.recording_view import View, failure_banner, plain_topics
from stepbus_tools.viewing.stage.stage import Framing, add_light
from stepbus_tools.viewing.viewpoint import Swept
from stepbus_tools.wiring import recorded_wiring

_IDLE_S = 5.0
"""So long without anything new, and a run has been killed, or its user is told."""
_START_S = 600.0
_LAST_S = 0.2
"""What a browser takes to be told the last."""
_RESULT_S = 5.0
"""How long a run may take from the end of its recording to its result [s]."""
_CHART_S = 0.25
_WORDS_S = 0.5
_RATE_S = 2.0
_POINTS = 900
"""Of a curve: half a minute."""
_MOST_MARKS = 400
_RECENT = 40
_decode_call = Decoder(CallRecord)
_BESIDE = (
    "<style>.wiring{overflow:auto}@media(min-width:60rem){.wiring{position:fixed;top:2vh;"
    "right:28rem;max-width:calc(100vw - 30rem);max-height:94vh;padding:1rem;"
    "background:var(--mantine-color-body)}}</style>"
)
"""The panel is too narrow for a picture of several participants."""
_BYTES = 2 * 1024 * 1024
"""Of a port: a type of the user's own may be large."""


class LivePage:
    """A live run on a page: its scene, curves, participants and controls.

    server: of viser. tail: of its recording, which has its first messages. client: of the run.
    """

    def __init__(self, server: Any, tail: Tail, client: RunClient) -> None:
        self._tail = tail
        self._client = client
        self._marks: list[Mark] = []
        events = (p.topic for p in tail.ports.values() if p.type in EVENT_TYPES)
        self._event_topics = dict.fromkeys((*events, layout.CALLS_TOPIC))
        tail.keep(self._event_topics)
        self._stopped_by_call = ""
        self._controls = Controls(server, client)
        self._plain_topics = plain_topics(tail.ports)
        self._points = Points(tail, self._plain_topics)
        scene = build_scene(tail)
        add_light(server.scene)
        self._framing, self._swept = Framing(server), Swept(scene)
        self._view = View(server, scene, tail.ports, self._points.sample)
        self._controls.add_tabs(self._view.tabs, self._view.stage, tail.ports)
        self._pace: deque[tuple[float, int]] = deque(maxlen=round(_RATE_S / _WORDS_S) + 1)
        self._charted_at = self._worded_at = 0.0
        self._is_unswept = False
        self._grown_at = time.monotonic()

    def follow(self, is_over: Callable[[], bool]) -> None:
        """Show the run thirty times a second until it has ended or died, or the viewer has."""
        # The first messages are there.
        is_new = True
        while not is_over() and not self._tail.is_complete:
            began = time.monotonic()
            is_new = self._tail.poll() or is_new
            self.turn(is_new)
            if self._client.is_lost and began - self._grown_at > _IDLE_S:
                break
            is_new = False
            time.sleep(max(0.0, FRAME_S - (time.monotonic() - began)))
        self.turn(self._tail.poll() or is_new)

    def turn(self, is_new: bool) -> None:
        """Update the page; is_new: whether messages have been recorded since the last turn."""
        now = time.monotonic()
        if is_new:
            messages = self._latest(self._view.topics)
            self._view.show(messages)
            self._controls.panel.follow(messages)
            self._points.add()
            self._grown_at = now
            self._is_unswept = True
        if now - self._charted_at >= _CHART_S:
            self._charted_at = now
            now_s = self._tail.last_step * self._step_s
            recent = [replace(mark, t=mark.t - now_s) for mark in self._marks[-_RECENT:]]
            self._view.curves.update(recent)
            if self._is_unswept:
                self._is_unswept = False
                self._swept.take(self._latest(self._view.stage.scene.topics))
            self._framing.turn(self._swept.box, self._swept.fixed)
        if now - self._worded_at >= _WORDS_S:
            self._worded_at = now
            self._view.offer_signals(self._latest(self._plain_topics))
            self._view.status.content = self._words(now)
            self._tell_events()
            self._controls.update(self._view.stopped or self._stopped_by_call)

    def _latest(self, topics: Iterable[str]) -> Messages:
        """Return topic → newest message, for ports with a readable message."""
        rows = ((topic, self._tail.latest(topic)) for topic in topics)
        return {topic: Latest(*row) for topic, row in rows if row is not None}

    def end(self, *, has_failed: bool) -> None:
        """Show that the run has ended, and hide the controls."""
        self._view.status.content = "**failed**" if has_failed else "**ended**"
        self._controls.end()

    def _words(self, now: float) -> str:
        """Return how far the run is, and whether it goes on."""
        words = headline(self._client.status, self._tail.last_step, self._rate())
        idle_s = now - self._grown_at
        if idle_s > _IDLE_S and self._client.status.get("phase") != "paused":
            words += f"  \n**no new data for {idle_s:.0f} s**"
        return words

    def _rate(self) -> float:
        """Return how fast the run went lately, as a factor of real time."""
        status = self._client.status
        if not status or status["phase"] == "paused":
            self._pace.clear()
            return math.nan
        self._pace.append((status["elapsed_s"], status["step"]))
        (began, first), (now, step) = self._pace[0], self._pace[-1]
        simulated_s = (step - first) * status["step_ns"] * 1e-9
        return simulated_s / (now - began) if now > began else math.nan

    @property
    def _step_s(self) -> float:
        return (self._tail.step_ns or 1_000_000_000) * 1e-9

    def _decoded(self, topic: str, data: bytes) -> object:
        """Return a decoded message or recorded call; None if it cannot be read."""
        with contextlib.suppress(StepbusError):
            is_call = topic == layout.CALLS_TOPIC
            return _decode_call(data) if is_call else self._tail.decode(topic, data)
        return None

    def _tell_events(self) -> None:
        marks = list[Mark]()
        for topic in self._event_topics:
            for step, data in self._tail.take_kept(topic):
                t_s, message = step * self._step_s, self._decoded(topic, data)
                mark = mark_of(topic.replace("/", ".", 1), t_s, message)
                marks += [] if mark is None else [mark]
                stop = stop_of(message, t_s) if isinstance(message, CallRecord) else None
                self._stopped_by_call = self._stopped_by_call if stop is None else stop
        if marks:
            self._marks = sorted([*self._marks, *marks], key=lambda mark: mark.t)[-_MOST_MARKS:]
            self._view.tell(self._marks)


def headline(status: Any, last_step: int, rate: float) -> str:
    """Return how far a run is, in words. rate: factor of real time; NaN while it is unknown."""
    if not status:
        return f"step {last_step}"
    t_s = status["step"] * status["step_ns"] * 1e-9
    total = "" if status["steps"] is None else f" of {status['steps']}"
    factor = "" if math.isnan(rate) else f", {rate:.2f} × real time"
    phase = "running" if status["phase"] == "stepping" else status["phase"]
    return f"**{phase}**, t = {t_s:.2f} s, step {status['step']}{total}{factor}"


class Points:
    """The last half minute of every port, so that a curve is there as soon as it is picked.

    It keeps the newest message of each frame.
    """

    def __init__(self, tail: Tail, topics: Iterable[str]) -> None:
        self._tail = tail
        self._kept: dict[str, deque[tuple[int, bytes]]] = {topic: deque() for topic in topics}
        self._rows: dict[tuple[str, str], deque[tuple[int, list[float]]]] = {}

    def add(self) -> None:
        """Keep the newest message of each port."""
        for topic, kept in self._kept.items():
            newest = self._tail.newest(topic)
            if newest is not None and (not kept or newest[0] > kept[-1][0]):
                kept.append(newest)
                while len(kept) > max(2, min(_POINTS, _BYTES // (len(newest[1]) + 1))):
                    kept.popleft()

    def sample(self, signal: Signal) -> Data:
        """Return a signal before now: times up to 0, shape (T,) [s], and values, shape (T, n)."""
        rows = self._rows.setdefault(signal.key, deque(maxlen=_POINTS))
        last = rows[-1][0] if rows else -1
        for step, data in self._kept.get(signal.topic, ()):
            message = self._tail.decode(signal.topic, data) if step > last else None
            if message is not None:
                rows.append((step, signal.values(message)))
        steps = np.array([step for step, _ in rows], dtype=np.float64)
        values = np.array([row for _, row in rows], dtype=np.float64)
        seconds = (steps - steps[-1:].sum()) * (self._tail.step_ns or 1_000_000_000) * 1e-9
        return seconds, values.reshape(len(steps), len(signal.names))


def follow(server: Any, folder: Path, is_over: Callable[[], bool]) -> bool:
    """Show a run on a page until it has ended, or the viewer has; return whether the run has.

    folder: of the run, which may not have begun. Raises RecordingFailed when it does not begin.
    """
    waiting, page = server.gui.add_markdown("waiting for the run to start …"), None
    with contextlib.ExitStack() as stack:
        if (tail := _wait_for(folder, is_over, stack)) is not None:
            client = RunClient(folder)
            stack.callback(client.close)
            waiting.remove()
            server.gui.set_panel_label(scenario_name(tail))
            page = LivePage(server, tail, client)
            server.gui.add_html(_BESIDE + recorded_wiring(tail))
            page.follow(is_over)
    has_ended = page is not None and not is_over()
    result = _result_of(folder, is_over) if has_ended or not (folder / LIVE_FILE).exists() else None
    failure = failure_banner(result)
    if page is not None and (has_ended or result):
        page.end(has_failed=bool(failure))
    if failure:
        server.gui.add_html(failure, order=-2.0)
    # The page may stay open for longer than what it shows.
    told = f"**This page is no longer live.** `stepbus view {folder}` shows the recording."
    server.gui.add_markdown(told, order=-1.0)
    server.flush()
    time.sleep(_LAST_S)
    return has_ended


def _result_of(folder: Path, is_over: Callable[[], bool]) -> Result | None:
    """Return the result of a run that has ended, which is written after its recording."""
    result, deadline = None, time.monotonic() + _RESULT_S
    while result is None and not is_over() and time.monotonic() < deadline:
        with contextlib.suppress(StepbusError, OSError), Recording(folder) as recording:
            result = result_beside(recording)
        time.sleep(_LAST_S)
    return result


def _wait_for(
    folder: Path, is_over: Callable[[], bool], stack: contextlib.ExitStack
) -> Tail | None:
    """Return the recording of a run as soon as it has messages; None when the viewer has ended."""
    deadline, path, tail = time.monotonic() + _START_S, folder / layout.RUN_FILE, None
    while not is_over():
        if tail is None and path.exists():
            tail = Tail(path)
            stack.callback(tail.close)
        if tail is not None and tail.poll() and tail.last_step >= 0:
            return tail
        if tail is not None and tail.is_complete:
            raise RecordingFailed(f"{path} has no messages; nothing to show")
        if time.monotonic() > deadline:
            raise RecordingFailed(f"{folder}: no run has started there for {_START_S:.0f} s")
        time.sleep(FRAME_S)
    return None
