"""All messages of a recording in the order of time, and the scene as it moves with them."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import groupby

from stepbus_orchestrator.recording import Port, Recording
from stepbus_schemas import Message, StepbusError
from stepbus_tools.viewing.exports.export_files import Reached, nothing_to_export, unreadable
from stepbus_tools.viewing.scene import Latest, Pose, Scene, build_scene

NS = 1_000_000_000


@dataclass(frozen=True, kw_only=True)
class Moment:
    """One message. step, t_ns: when it was published; t_ns [ns]."""

    step: int
    t_ns: int
    port: Port
    message: Message


def instants(
    recording: Recording, ports: Collection[Port], lost: dict[str, str], reached: Reached
) -> Iterator[tuple[int, list[Moment]]]:
    """Yield each time [ns] and the messages of some ports at it, in memory that does not grow.

    lost: topic → why it is; gets a port that cannot be read to its end.
    """
    in_order = _moments(recording, ports, lost, reached)
    for t_ns, group in groupby(in_order, key=lambda moment: moment.t_ns):
        yield t_ns, list(group)


def _moments(
    recording: Recording, ports: Collection[Port], lost: dict[str, str], reached: Reached
) -> Iterator[Moment]:
    for piece in recording.batches(ports):
        rows: list[tuple[int, int, Moment]] = []
        for number, port in enumerate(ports):
            batch = piece[port.topic]
            if not len(batch.steps) or port.topic in lost:
                continue
            try:
                for step, t, message in zip(batch.steps, batch.t, batch.messages(), strict=True):
                    each = Moment(
                        step=int(step), t_ns=round(float(t) * NS), port=port, message=message
                    )
                    rows.append((each.t_ns, number, each))
            except StepbusError as exc:
                lost[port.topic] = f"{port.topic}: {exc}"
        for _, _, moment in sorted(rows, key=lambda row: row[:2]):
            yield moment
        if rows:
            reached(rows[-1][2].step)


def readable(recording: Recording, lost: dict[str, str]) -> list[Port]:
    """Return the ports with messages of a known type.

    lost: topic → why it is; gets those of an unknown type. Raises RecordingFailed without any.
    """
    ports = []
    for port in recording.ports.values():
        if port.topic.startswith("stepbus/"):
            continue
        try:
            port.message_class  # noqa: B018  (raises for an unknown type)
        except StepbusError as exc:
            lost[port.topic] = unreadable(port, exc)
            continue
        if port.last_step >= 0:
            ports.append(port)
    if not ports:
        raise nothing_to_export(recording)
    return ports


class Moving:
    """The scene of a recording; give it all its instants. period_ns: between two poses.

    latest: the newest messages that it was given.
    """

    def __init__(self, recording: Recording, period_ns: int) -> None:
        self.scene: Scene = build_scene(recording.path, recording.ports, recording.attachments)
        self.latest: dict[str, Latest] = {}
        self._period_ns = period_ns
        self._due_ns = 0

    def still(self) -> dict[str, Pose]:
        """Return frame → its pose in its parent at the start, of all frames."""
        return {frame.name: frame.pose for frame in self.scene.frames if not frame.is_ghost}

    def take(self, t_ns: int, moments: Collection[Moment]) -> dict[str, Pose]:
        """Take an instant; return the frames to place now, none before the next is due."""
        known = [moment for moment in moments if moment.port.topic in self.scene.topics]
        for moment in known:
            self.latest[moment.port.topic] = Latest(step=moment.step, message=moment.message)
        if not known or t_ns < self._due_ns:
            return {}
        self._due_ns = t_ns + self._period_ns
        shown = self.still()
        return {n: pose for n, pose in self.scene.poses(self.latest).items() if n in shown}


class Rate:
    """Lets at most so many messages of each topic pass."""

    def __init__(self, per_s: float) -> None:
        self._period_ns = round(NS / per_s)
        self._due: dict[str, int] = {}

    def passes(self, topic: str, t_ns: int) -> bool:
        """Return whether a message at a time is due."""
        if t_ns < self._due.get(topic, 0):
            return False
        # On a grid: a message that is a little late does not delay the ones behind it.
        self._due[topic] = (t_ns // self._period_ns + 1) * self._period_ns
        return True
