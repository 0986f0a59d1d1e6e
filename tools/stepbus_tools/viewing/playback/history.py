"""What a recording says at a time, read when it is asked for."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from stepbus_orchestrator.recording import Recording
from stepbus_schemas import Event, MessageError, WiringError
from stepbus_tools.viewing.scene import Latest, Messages
from stepbus_tools.viewing.stage.curves import Data
from stepbus_tools.viewing.stage.signals import Signal, value_of

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
        found: dict[str, Latest] = {}
        for topic in topics:
            port = self.recording.ports.get(topic)
            try:
                row = None if port is None else port.latest(t_ns)
            except (MessageError, WiringError):
                continue
            if row is not None:
                found[topic] = Latest(step=row[0], message=row[1])
        return found

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
        found: list[tuple[int, str]] = []
        for port in self.recording.of_type("Event/1"):
            try:
                for step, message in port.messages():
                    if isinstance(message, Event) and len(found) < _MOST_EVENTS:
                        text = f"{port.participant}: {message.text.splitlines()[0]}"
                        found.append((step * self.step_ns, f"{message.level}: {text}"))
            except (MessageError, WiringError, IndexError):
                continue
        return sorted(found)
