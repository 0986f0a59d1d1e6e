"""What a recording says at a time, read when it is asked for."""

import threading
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import Event, MessageError, StepbusError, WiringError
from stepbus_tools.viewing.exports import check_readable
from stepbus_tools.viewing.scene import Latest, Messages, build_scene
from stepbus_tools.viewing.stage import Stage
from stepbus_tools.viewing.stage.stage import OTHER_COLOR
from stepbus_tools.viewing.stage.stage_curves import Data, Signal, value_of
from stepbus_tools.viewing.stage.stage_view import View, plain_topics

_SAMPLES = 400
_MOST_EVENTS = 300


class History:
    """A recording at any time. end_ns: of its last message [ns]; steps: its newest one."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        ends = [row for port in recording.ports.values() if (row := port.last) is not None]
        self.end_ns = max((row.t_ns for row in ends), default=0)
        self.last_step = max((row.step for row in ends), default=-1)

    @property
    def step_ns(self) -> int:
        """Return the length of a step [ns], as the recording has it."""
        return self.end_ns // self.last_step if self.last_step > 0 else 1

    def at(self, topics: Iterable[str], t_ns: int) -> Messages:
        """Return the newest message of each port at a time [ns].

        A port whose message cannot be read is left out: what else there is, is shown.
        """
        latest: dict[str, Latest] = {}
        for topic in topics:
            port = self.recording.ports.get(topic)
            try:
                row = None if port is None else port.latest(t_ns)
            except (MessageError, WiringError):
                continue
            if row is not None:
                latest[topic] = Latest(step=row[0], message=row[1])
        return latest

    def samples(self, signal: Signal) -> Data:
        """Return a signal over the whole recording, at evenly spaced times."""
        last = max(1, min(_SAMPLES, self.last_step))
        times: list[float] = []
        rows: list[list[float]] = []
        for number in range(last + 1):
            t_ns = self.end_ns * number // last
            latest = self.at((signal.topic,), t_ns).get(signal.topic)
            if latest is not None:
                times.append(t_ns * 1e-9)
                rows.append(value_of(signal, latest.message))
        values: Any = np.array(rows, dtype=np.float64).reshape(len(rows), len(signal.names))
        return np.array(times), values

    def events(self) -> list[tuple[int, str]]:
        """Return (time [ns], sentence) of the events in it; it reads only chunks that have some."""
        events: list[tuple[int, str]] = []
        for port in self.recording.of_type("Event/1"):
            try:
                for step, message in port.messages():
                    if isinstance(message, Event) and len(events) < _MOST_EVENTS:
                        text = f"{port.participant}: {message.text.splitlines()[0]}"
                        events.append((step * self.step_ns, f"{message.level}: {text}"))
            except (MessageError, WiringError, IndexError):
                continue
        return sorted(events)


FRAME_S = 1 / 30
SPEEDS = {"0.1 ×": 0.1, "0.25 ×": 0.25, "0.5 ×": 0.5, "1 ×": 1.0, "2 ×": 2.0, "5 ×": 5.0}
_JUMP = "jump to an event"
_STEPS = ("first", "back", "next", "last")
_MOST_MARKS = 40
_SLOWLY_S = 0.5


def open_recording(path: Path) -> Recording:
    """Return a recording that has something to show.

    Raises RecordingFailed for a file that is none, or has no messages of types that it knows.
    """
    recording = Recording(path)
    if recording.last_step < 0:
        why = f": it {recording.cut_short}" if recording.cut_short else ""
        recording.close()
        raise RecordingFailed(f"{recording.path} has no messages, so there is nothing to show{why}")
    try:
        check_readable(recording)
    except RecordingFailed:
        recording.close()
        raise
    return recording


class Playback:
    """A recording on a page, with its time.

    server: of viser. other: a second recording, drawn as a ghost at the same time. is_playing:
    whether its time goes on by itself.
    """

    def __init__(self, server: Any, recording: Recording, other: Recording | None = None) -> None:
        self._server = server
        self._history = History(recording)
        self._other = None if other is None else History(other)
        scene = build_scene(recording.path, recording.ports, recording.attachments)
        self._t_ns = 0
        self.is_playing = False
        self._jumps: dict[str, int] = {}
        self._pending: list[Callable[[], None]] = []
        self._lock = threading.Lock()
        self._add_time()
        self._view = View(server, scene, recording.ports, self._history.samples)
        self._stage = None if other is None else self._add_other(other)
        self._show()
        self._offer()
        threading.Thread(target=self._find_events, name="events", daemon=True).start()
        if other is not None:
            threading.Thread(
                target=self._find_divergence, args=(other.path,), name="diff", daemon=True
            ).start()

    # --- the controls ---------------------------------------------------------------------

    def _add_time(self) -> None:
        gui, end_s = self._server.gui, max(self._history.end_ns * 1e-9, 1e-6)
        self._slider = gui.add_slider(
            "time [s]", min=0.0, max=end_s, step=self._history.step_ns * 1e-9, initial_value=0.0
        )
        self._slider.on_update(self._dragged)
        self._play = gui.add_button("play")
        self._play.on_click(lambda _: self.play(playing=not self.is_playing))
        self._step = gui.add_button_group("step", _STEPS)
        self._step.on_click(lambda _: self._stepped(str(self._step.value)))
        self._speed = gui.add_dropdown("speed", tuple(SPEEDS), initial_value="1 ×")
        self._jump = gui.add_dropdown("event", (_JUMP,), initial_value=_JUMP)
        self._jump.on_update(lambda _: self._jumped())

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
        self.seek(number * history.step_ns)

    def seek(self, t_ns: int) -> None:
        """Go to a time [ns]."""
        self._t_ns = min(max(0, t_ns), self._history.end_ns)

    def _jumped(self) -> None:
        t_ns = self._jumps.get(self._jump.value)
        if t_ns is not None:
            self.seek(t_ns)

    # --- what is found in the background --------------------------------------------------

    def _later(self, work: Callable[[], None]) -> None:
        """Let the page's own thread do something: it alone touches the page."""
        with self._lock:
            self._pending.append(work)

    def _find_events(self) -> None:
        with Recording(self._history.recording.path) as recording:
            events = History(recording).events()
        self._later(lambda: self._offer_events(events))

    def _offer_events(self, events: list[tuple[int, str]]) -> None:
        rows = [(t_ns, f"{t_ns * 1e-9:.3f} s {text}") for t_ns, text in events]
        self._view.tell([text for _, text in rows])
        self._add_jumps({text: t_ns for t_ns, text in rows})

    def _add_jumps(self, jumps: dict[str, int]) -> None:
        self._jumps |= jumps
        self._jump.options = (_JUMP, *sorted(self._jumps, key=self._jumps.__getitem__))
        marks = sorted({round(t_ns * 1e-9, 9) for t_ns in self._jumps.values()})
        self._slider.marks = tuple(marks) if len(marks) <= _MOST_MARKS else ()

    def _find_divergence(self, other: Path) -> None:
        try:
            difference = diff(self._history.recording.path, other)
        except StepbusError as exc:
            text = str(exc)
            self._later(lambda: self._view.tell([text]))
            return
        if difference.divergence is None:
            self._later(lambda: self._add_jumps({"0.000 s both recordings are equal": 0}))
            return
        t_ns = difference.divergence.step * self._history.step_ns
        text = f"{t_ns * 1e-9:.3f} s first divergence: {difference.divergence.text()}"
        self._later(lambda: self._add_jumps({text: t_ns}))

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
        with self._lock:
            pending, self._pending = self._pending, []
        for work in pending:
            work()
        if self.is_playing:
            speed = SPEEDS[self._speed.value]
            self._t_ns = min(self._t_ns + round(elapsed_s * speed * 1e9), self._history.end_ns)
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

    def _offer(self) -> None:
        self._view.offer_signals(
            self._history.at(plain_topics(self._history.recording.ports), self._history.end_ns)
        )

    def _add_other(self, other: Recording) -> Stage:
        scene = build_scene(other.path, other.ports, other.attachments)
        return Stage(self._server, scene, "/other", OTHER_COLOR)


def play(playback: Playback, is_over: Callable[[], bool]) -> None:
    """Keep a page going until it is over."""
    before = time.monotonic()
    while not is_over():
        now = time.monotonic()
        playback.turn(min(now - before, _SLOWLY_S))
        before = now
        time.sleep(max(0.0, FRAME_S - (time.monotonic() - now)))
