"""A recording at any time, read when it is asked for."""

from collections.abc import Iterable

from stepbus_orchestrator.recording import Recording
from stepbus_schemas import MessageError, WiringError
from stepbus_tools.viewing.scene import Latest, Messages


class History:
    """A recording at any time. end_ns: of its last message [ns]; last_step: its newest one."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        ends = [row for port in recording.ports.values() if (row := port.last) is not None]
        self.end_ns = max((row.t_ns for row in ends), default=0)
        self.last_step = max((row.step for row in ends), default=-1)

    @property
    def step_ns(self) -> int:
        """Return the length of a step [ns], as the recording has it."""
        return self.end_ns // self.last_step if self.last_step > 0 else 1

    def times(self, count: int) -> list[int]:
        """Return evenly spaced times from its start to its end [ns], one more than `count`."""
        return [self.end_ns * number // count for number in range(count + 1)]

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
