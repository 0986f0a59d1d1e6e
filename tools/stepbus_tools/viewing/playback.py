"""A recording on a page: its time, and the controls of it."""

import contextlib
import math
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.recording import Recording, layout
from stepbus_orchestrator.run.result import result_beside
from stepbus_schemas import StepbusError
from stepbus_tools.report.charts import Mark
from stepbus_tools.viewing.exports import check_readable
from stepbus_tools.viewing.history import History, read_timeline, stop_of, timed_messages
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.stage.chart_tab import Data, Signal
from stepbus_tools.viewing.stage.recording_view import (
    View,
    failure_banner,
    plain_topics,
    stop_banner,
)
from stepbus_tools.viewing.stage.stage import OTHER_COLOR, Framing, Stage, add_light
from stepbus_tools.viewing.viewpoint import swept

_SAMPLES = 400
"""Times at which it is looked what moves."""
_FRAME_S = 1 / 30
_CHART_S = 0.15
_SPEEDS = {"0.1 ×": 0.1, "0.25 ×": 0.25, "0.5 ×": 0.5, "1 ×": 1.0, "2 ×": 2.0, "5 ×": 5.0}
_JUMP = "jump to an event"
_STEPS = ("« first", "‹ back", "next ›", "last »")
_KEYS = (
    ("arrowleft", "a step back"),
    ("arrowright", "a step on"),
    ("home", "the first step"),
    ("end", "the last step"),
)
_SLOWLY_S = 0.5
_TOP = -2.0
"""Order of what is above all else."""
_PLAY, _PAUSE = "player-play-filled", "player-pause-filled"


def open_recording(path: Path) -> Recording:
    """Return a recording that has something to show.

    Raises RecordingFailed for a file that is none, or has no messages of types that it knows.
    """
    with contextlib.ExitStack() as stack:
        recording = stack.enter_context(Recording(path))
        check_readable(recording)
        stack.pop_all()
    return recording


def _parting(path: Path, other: Path, runs: Sequence[str], step_s: float) -> Mark:
    """Return the mark of the first difference of two recordings. step_s: length of a step [s]."""
    try:
        divergence = diff(path, other).divergence
    except StepbusError as exc:
        return Mark(t=0.0, level="info", text=str(exc))
    if divergence is None:
        return Mark(t=0.0, level="info", text="both recordings are equal")
    return Mark(t=divergence.step * step_s, level="divergence", text=divergence.text(*runs))


class Playback:
    """A recording on a page, with a time that all of its visitors share.

    server: of viser. other: a second recording, drawn as a ghost at the same time. is_playing:
    whether time goes on by itself. jumps: text of an event → its time [ns].
    """

    def __init__(self, server: Any, recording: Recording, other: Recording | None = None) -> None:
        recordings = [recording] if other is None else [recording, other]
        self._histories = histories = [History(one) for one in recordings]
        self._history = histories[0]
        scenes = [build_scene(one) for one in recordings]
        self._runs = runs = run_names([one.path for one in recordings])
        # What is found in the background: all marks, and time [ns] and author of each stop by a
        # call; empty: a release.
        self._found: tuple[Mark, ...] = ()
        self._stops: list[tuple[int, str]] = []
        paths = [one.path for one in recordings]
        threading.Thread(target=self._find, args=paths, name="events", daemon=True).start()
        add_light(server.scene)
        self._framing, self._swept = Framing(server), swept(scenes[0], self._history)
        self._gui = server.gui
        self._marks: tuple[Mark, ...] = ()
        self.jumps: dict[str, int] = {}
        self._t_ns = 0
        self._shown_ns = -1
        self._charted_s = 0.0
        self._samples: dict[tuple[str, str], Data] = {}
        self.is_playing = False
        names = runs if histories[1:] else ("",)
        banners = (
            failure_banner(result_beside(one.recording), name)
            for one, name in zip(histories, names, strict=True)
        )
        if failures := "".join(banners):
            self._gui.add_html(failures, order=_TOP)
        self._stop = self._gui.add_html("", order=_TOP)
        self._slider = self._add_slider()
        self._add_controls(self._gui)
        compared = runs if histories[1:] else ()
        self.view = View(server, scenes[0], recording.ports, self._sample, compared)
        self._others = [
            (history, Stage(server, scene, "/other", OTHER_COLOR))
            for history, scene in zip(histories[1:], scenes[1:], strict=True)
        ]
        self._show()
        topics = plain_topics(recording.ports)
        self.view.offer_signals(self._history.at(topics, self._history.end_ns))

    def _find(self, path: Path, other: Path | None = None) -> None:
        """Collect the events of a recording, and its first divergence from another."""
        with Recording(path) as recording:
            events, _ = read_timeline(recording, result_beside(recording))
            if calls := recording.ports.get(layout.CALLS_TOPIC):
                rows = ((t_ns, stop_of(call, t_ns * 1e-9)) for t_ns, call in timed_messages(calls))
                self._stops = [(t_ns, stop) for t_ns, stop in rows if stop is not None]
            self._found = tuple(events)
            if other is not None:
                step_s = History(recording).step_ns * 1e-9
                parting = _parting(path, other, self._runs, step_s)
                self._found = tuple(sorted([*events, parting], key=lambda mark: mark.t))

    def _sample(self, signal: Signal) -> Data:
        """Return a signal over the whole recording, at evenly spaced times."""
        if signal.key not in self._samples:
            self._samples[signal.key] = self._read(signal)
        return self._samples[signal.key]

    def _read(self, signal: Signal) -> Data:
        times = self._history.times(max(1, min(_SAMPLES, self._history.last_step)))
        values = np.full((len(times), len(self._histories), len(signal.names)), math.nan)
        for number, history in enumerate(self._histories):
            for row, t_ns in enumerate(times):
                latest = history.at((signal.topic,), t_ns).get(signal.topic)
                if latest is not None and t_ns <= history.end_ns:
                    values[row, number] = signal.values(latest.message)
        return np.array(times) * 1e-9, values.reshape(len(times), -1)

    # --- the controls ---------------------------------------------------------------------

    def _add_slider(self) -> Any:
        end_s, step_s = max(self._history.end_ns * 1e-9, 1e-6), self._history.step_ns / 1e9
        slider = self._gui.add_slider(
            "time [s]",
            min=0.0,
            max=end_s,
            step=step_s,
            initial_value=0.0,
            order=_TOP + 1,
        )
        slider.on_update(self._dragged)
        return slider

    def _add_controls(self, gui: Any) -> None:
        self._play = gui.add_button("play", icon=_PLAY, hint="space")
        self._play.on_click(lambda _: self.play(playing=not self.is_playing))
        self._step = gui.add_button_group("step", _STEPS, hint="←, →, home, end")
        self._step.on_click(lambda _: self._stepped(_STEPS.index(self._step.value)))
        self._speed = gui.add_dropdown("speed", tuple(_SPEEDS), initial_value="1 ×")
        self._jump = gui.add_dropdown("event", (_JUMP,), initial_value=_JUMP, visible=False)
        self._jump.on_update(lambda _: self._seek(self.jumps.get(self._jump.value, self._t_ns)))
        play = gui.add_command("play or pause", hotkey="space")
        play.on_trigger(lambda _: self.play(playing=not self.is_playing))
        for which, (key, label) in zip((1, 2, 0, 3), _KEYS, strict=True):
            step = gui.add_command(label, hotkey=key)
            step.on_trigger(lambda _, which=which: self._stepped(which))

    def _dragged(self, event: Any) -> None:
        # What this process sets has no client.
        if event.client_id is not None:
            self._t_ns = self._step_at(self._slider.value)

    def _step_at(self, t_s: float) -> int:
        """Return the time of the nearest step [ns]; seconds alone lose nanoseconds in 52 days."""
        step_ns = self._history.step_ns
        return round(t_s * 1e9 / step_ns) * step_ns

    def play(self, *, playing: bool) -> None:
        """Play, or hold; at its end, it starts anew."""
        if playing and self._t_ns >= self._history.end_ns:
            self._t_ns = 0
        self.is_playing = playing
        self._play.label, self._play.icon = ("pause", _PAUSE) if playing else ("play", _PLAY)

    def _stepped(self, which: int) -> None:
        """Go to the first step, back, on, or to the last one."""
        history = self._history
        self.play(playing=False)
        step = round(self._t_ns / history.step_ns)
        self._seek((0, step - 1, step + 1, history.last_step)[which] * history.step_ns)

    def _seek(self, t_ns: int) -> None:
        self._t_ns = min(max(0, t_ns), self._history.end_ns)

    def _mark(self) -> None:
        """Show the marks found in the background."""
        self._marks = self._found
        self.jumps = {mark.label: self._step_at(mark.t) for mark in self._marks}
        self._jump.options = (_JUMP, *self.jumps)
        self._jump.visible = bool(self.jumps)
        self.view.tell(self._marks)

    # --- time -----------------------------------------------------------------------------

    def turn(self, elapsed_s: float) -> None:
        """Advance by the time since the last turn [s], and update the page."""
        if self._marks is not self._found:
            self._mark()
        if self.is_playing:
            speed = _SPEEDS[self._speed.value]
            self._seek(self._t_ns + round(elapsed_s * speed * 1e9))
            if self._t_ns >= self._history.end_ns:
                self.play(playing=False)
        if self._t_ns != self._shown_ns:
            self._slider.value = self._t_ns * 1e-9
            self._show()
        self._charted_s += elapsed_s
        if self._charted_s >= _CHART_S:
            self._charted_s = 0.0
            self.view.curves.update(self._marks, self._t_ns * 1e-9)
        self._framing.turn(self._swept.box, self._swept.fixed)

    def _show(self) -> None:
        t_ns, history = self._t_ns, self._history
        self._shown_ns = t_ns
        moving = self.view.stage.scene.topics
        self.view.show(
            history.at(self.view.topics, t_ns),
            lambda step: history.at(moving, step * history.step_ns),
        )
        for other, stage in self._others:
            stage.move(stage.scene.poses(other.at(stage.scene.topics, t_ns)))
        called = [who for since_ns, who in self._stops if since_ns <= t_ns]
        banner = stop_banner(self.view.stopped or next(reversed(called), ""))
        if banner != self._stop.content:
            self._stop.content = banner
        step = round(t_ns / history.step_ns)
        why = history.recording.cut_short
        note = f"  \nthe recording **{why}**; showing everything before that" if why else ""
        for run, (other, _) in zip(self._runs[1:], self._others, strict=True):
            if t_ns > other.end_ns:
                note += f"  \n{run} has ended at {other.end_ns * 1e-9:.3f} s"
        self.view.status.content = (
            f"**t = {t_ns * 1e-9:.3f} s**, step {step} of {history.last_step}{note}"
        )


def run_names(paths: Sequence[Path]) -> list[str]:
    """Return the folders of recordings, with as much of their paths as tells them apart."""
    folders = [path.resolve().parent.parts for path in paths]
    for count in range(1, max(map(len, folders)) + 1):
        names = [str(Path(*folder[-count:])) for folder in folders]
        if len(set(names)) == len(names):
            return names
    return [str(path) for path in paths]


def play(playback: Playback, is_over: Callable[[], bool]) -> None:
    """Keep a page going until it is over."""
    before = time.monotonic()
    while not is_over():
        now = time.monotonic()
        playback.turn(min(now - before, _SLOWLY_S))
        before = now
        time.sleep(max(0.0, _FRAME_S - (time.monotonic() - now)))
