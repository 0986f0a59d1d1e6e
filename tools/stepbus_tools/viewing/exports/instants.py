"""All messages of a recording in the order of time."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import groupby

from stepbus_orchestrator.recording import Port, Recording
from stepbus_schemas import Message, StepbusError
from stepbus_tools.columns import readable
from stepbus_tools.viewing.exports.exporter import Reached, nothing_to_export
from stepbus_tools.viewing.scene.bodies import Latest, Messages
from stepbus_tools.viewing.scene.scene import Scene

NS = 1_000_000_000
_PER_S = 30.0


@dataclass(frozen=True, kw_only=True)
class Instant:
    """One message. step, t_ns: when it was published; t_ns [ns]."""

    step: int
    t_ns: int
    port: Port
    message: Message


def readable_ports(recording: Recording) -> tuple[list[Port], dict[str, str]]:
    """Return the ports with messages of a known type; and topic → why another is lost.

    Raises RecordingFailed without any.
    """
    tables, lost = readable(recording)
    if not tables:
        raise nothing_to_export(recording)
    return [table.port for table in tables], lost


def instants(
    recording: Recording, ports: Collection[Port], lost: dict[str, str], reached: Reached
) -> Iterator[tuple[int, list[Instant]]]:
    """Yield each time [ns] and the messages of some ports at it, in memory that does not grow.

    lost: topic → why it is; gets a port that cannot be read to its end.
    """
    in_order = _in_order(recording, ports, lost, reached)
    for t_ns, group in groupby(in_order, key=lambda instant: instant.t_ns):
        yield t_ns, list(group)


def thinned(
    recording: Recording,
    scene: Scene,
    ports: Collection[Port],
    lost: dict[str, str],
    reached: Reached,
) -> Iterator[tuple[int, Messages, list[Instant]]]:
    """Yield each time [ns], what places the scene where it has moved, and the messages at it.

    At most 30 poses of the scene, and messages of each topic, in a second; events are all there.
    lost: as of `instants`.
    """
    rate, latest = Rate(_PER_S), dict[str, Latest]()
    for t_ns, group in instants(recording, ports, lost, reached):
        moving = [i for i in group if i.port.topic in scene.topics]
        latest |= {i.port.topic: Latest(i.step, i.message) for i in moving}
        has_moved = bool(moving) and rate.passes("", t_ns)
        passed = [i for i in group if i.port.type == "Event/1" or rate.passes(i.port.topic, t_ns)]
        yield t_ns, latest if has_moved else {}, passed


def _in_order(
    recording: Recording, ports: Collection[Port], lost: dict[str, str], reached: Reached
) -> Iterator[Instant]:
    for piece in recording.batches(ports):
        rows = list[Instant]()
        for port in ports:
            batch = piece[port.topic]
            if port.topic in lost:
                continue
            try:
                clock = zip(batch.steps.tolist(), batch.t_ns.tolist(), strict=True)
                for (step, t_ns), message in zip(clock, batch.messages(), strict=True):
                    rows.append(Instant(step=step, t_ns=t_ns, port=port, message=message))
            except StepbusError as exc:
                lost[port.topic] = f"{port.topic}: {exc}"
        # At one time, they are in the order of the ports.
        yield from sorted(rows, key=lambda instant: instant.t_ns)
        if rows:
            reached(rows[-1].step)


class Rate:
    """Lets at most so many messages of each topic pass; all with `math.inf`."""

    def __init__(self, per_s: float) -> None:
        self._period_ns = max(1, round(NS / per_s))
        self._due: dict[str, int] = {}

    def passes(self, topic: str, t_ns: int) -> bool:
        """Return whether a message at a time is due."""
        if t_ns < self._due.get(topic, 0):
            return False
        # On a grid: a message that is a little late does not delay the ones behind it.
        self._due[topic] = (t_ns // self._period_ns + 1) * self._period_ns
        return True
