"""A recording on a page, with its time."""

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import Event, StepbusError
from stepbus_tools.viewing.exports import check_readable
from stepbus_tools.viewing.history import History, timed_messages
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.stage.curves import Data, Signal
from stepbus_tools.viewing.stage.stage import OTHER_COLOR, Stage
from stepbus_tools.viewing.stage.view import View, plain_topics

_SAMPLES = 400
_MOST_EVENTS = 300
_FRAME_S = 1 / 30
_SPEEDS = {"0.1 ×": 0.1, "0.25 ×": 0.25, "0.5 ×": 0.5, "1 ×": 1.0, "2 ×": 2.0, "5 ×": 5.0}
_JUMP = "jump to an event"
_STEPS = ("first", "back", "next", "last")
_MOST_MARKS = 40
_SLOWLY_S = 0.5


def open_recording(path: Path) -> Recording:
    """Return a recording that has something to show.

    Raises RecordingFailed for a file that is none, or has no messages of types that it knows.
    """
    with contextlib.ExitStack() as stack:
        recording = stack.enter_context(Recording(path))
        if recording.last_step < 0:
            why = f": it {recording.cut_short}" if recording.cut_short else ""
            text = f"{recording.path} has no messages, so there is nothing to show{why}"
            raise RecordingFailed(text)
        check_readable(recording)
        stack.pop_all()
    return recording


class Playback:
    """A recording on a page, with its time.

    server: of viser. other: a second recording, drawn as a ghost at the same time. is_playing:
    whether its time goes on by itself.
    """

    def __init__(self, server: Any, recording: Recording, other: Recording | None = None) -> None:
        self._history = History(recording)
        self._other = None if other is None else History(other)
        self._t_ns = 0
        self.is_playing = False
        self._jumps: dict[str, int] = {}
        # Work for the page's own thread, which alone touches the page.
        self._pending: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._add_time(server.gui)
        self._view = View(server, build_scene(recording), recording.ports, self._samples)
        self._stage: Stage | None = None
        if other is not None:
            self._stage = Stage(server, build_scene(other), "/other", OTHER_COLOR)
        self._show()
        topics = plain_topics(recording.ports)
        self._view.offer_signals(self._history.at(topics, self._history.end_ns))
        threading.Thread(target=self._find_events, name="events", daemon=True).start()
        if other is not None:
            find = threading.Thread(
                target=self._find_divergence, args=(other.path,), name="diff", daemon=True
            )
            find.start()

    def _samples(self, signal: Signal) -> Data:
        """Return a signal over the whole recording, at evenly spaced times."""
        history = self._history
        times: list[float] = []
        rows: list[list[float]] = []
        for t_ns in history.times(max(1, min(_SAMPLES, history.last_step))):
            latest = history.at((signal.topic,), t_ns).get(signal.topic)
            if latest is not None:
                times.append(t_ns * 1e-9)
                rows.append(signal.values(latest.message))
        values: Any = np.array(rows, dtype=np.float64).reshape(len(rows), len(signal.names))
        return np.array(times), values

    # --- the controls ---------------------------------------------------------------------

    def _add_time(self, gui: Any) -> None:
        end_s, step_s = max(self._history.end_ns * 1e-9, 1e-6), self._history.step_ns * 1e-9
        self._slider = gui.add_slider(
            "time [s]", min=0.0, max=end_s, step=step_s, initial_value=0.0
        )
        self._slider.on_update(self._dragged)
        self._play = gui.add_button("play")
        self._play.on_click(lambda _: self.play(playing=not self.is_playing))
        self._step = gui.add_button_group("step", _STEPS)
        self._step.on_click(lambda _: self._stepped(str(self._step.value)))
        self._speed = gui.add_dropdown("speed", tuple(_SPEEDS), initial_value="1 ×")
        self._jump = gui.add_dropdown("event", (_JUMP,), initial_value=_JUMP)
        self._jump.on_update(lambda _: self._seek(self._jumps.get(self._jump.value, self._t_ns)))

    def _dragged(self, event: Any) -> None:
        # What this process sets has no client.
        if event.client_id is not None:
            self._t_ns = round(self._slider.value * 1e9)

    def play(self, *, playing: bool) -> None:
        """Play, or hold; at its end, it starts anew."""
        if playing and self._t_ns >= self._history.end_ns:
            self._t_ns = 0
        self.is_playing = playing
        self._play.label = "pause" if playing else "play"

    def _stepped(self, which: str) -> None:
        history = self._history
        self.play(playing=False)
        step = round(self._t_ns / history.step_ns)
        number = {"first": 0, "back": step - 1, "next": step + 1, "last": history.last_step}[which]
        self._seek(number * history.step_ns)

    def _seek(self, t_ns: int) -> None:
        self._t_ns = min(max(0, t_ns), self._history.end_ns)

    # --- what is found in the background --------------------------------------------------

    def _find_events(self) -> None:
        events: list[tuple[int, str]] = []
        with Recording(self._history.recording.path) as recording:
            for port in recording.of_type("Event/1"):
                for t_ns, message in islice(timed_messages(port), _MOST_EVENTS):
                    if isinstance(message, Event):
                        text = (message.text.splitlines() or [""])[0]
                        who = f"{message.level}: {port.participant}"
                        events.append((t_ns, f"{t_ns * 1e-9:.3f} s {who}: {text}"))
        events = sorted(events)[:_MOST_EVENTS]
        self._pending.put(lambda: self._view.tell([text for _, text in events]))
        self._pending.put(lambda: self._add_jumps({text: t_ns for t_ns, text in events}))

    def _add_jumps(self, jumps: dict[str, int]) -> None:
        self._jumps |= jumps
        self._jump.options = (_JUMP, *sorted(self._jumps, key=self._jumps.__getitem__))
        marks = sorted({round(t_ns * 1e-9, 9) for t_ns in self._jumps.values()})
        self._slider.marks = tuple(marks) if len(marks) <= _MOST_MARKS else ()

    def _find_divergence(self, other: Path) -> None:
        try:
            divergence = diff(self._history.recording.path, other).divergence
        except StepbusError as exc:
            text = str(exc)
            self._pending.put(lambda: self._view.tell([text]))
            return
        t_ns, text = 0, "0.000 s both recordings are equal"
        if divergence is not None:
            t_ns = divergence.step * self._history.step_ns
            text = f"{t_ns * 1e-9:.3f} s first divergence: {divergence.text()}"
        self._pending.put(lambda: self._add_jumps({text: t_ns}))

    @property
    def status(self) -> str:
        """Return how far it is, as Markdown."""
        return str(self._view.status.content)

    @property
    def events(self) -> Sequence[str]:
        """Return what the viewer can jump to."""
        return list(self._jumps)

    # --- time -----------------------------------------------------------------------------

    def turn(self, elapsed_s: float) -> None:
        """Go on by the time since the last turn [s], and show what is new."""
        while not self._pending.empty():
            self._pending.get_nowait()()
        if self.is_playing:
            speed = _SPEEDS[self._speed.value]
            self._seek(self._t_ns + round(elapsed_s * speed * 1e9))
            if self._t_ns >= self._history.end_ns:
                self.play(playing=False)
        if self._t_ns != self._shown_ns:
            self._slider.value = self._t_ns * 1e-9
            self._show()

    def _show(self) -> None:
        t_ns, history = self._t_ns, self._history
        self._shown_ns = t_ns
        self._view.show(history.at(self._view.topics, t_ns))
        if self._stage is not None and self._other is not None:
            scene = self._stage.scene
            self._stage.move(scene.poses(self._other.at(scene.topics, t_ns)))
        step = round(t_ns / history.step_ns)
        why = history.recording.cut_short
        note = f"  \nthe recording **{why}**; what precedes that is shown" if why else ""
        self._view.status.content = (
            f"**t = {t_ns * 1e-9:.3f} s**, step {step} of {history.last_step}{note}"
        )


def play(playback: Playback, is_over: Callable[[], bool]) -> None:
    """Keep a page going until it is over."""
    before = time.monotonic()
    while not is_over():
        now = time.monotonic()
        playback.turn(min(now - before, _SLOWLY_S))
        before = now
        time.sleep(max(0.0, _FRAME_S - (time.monotonic() - now)))
