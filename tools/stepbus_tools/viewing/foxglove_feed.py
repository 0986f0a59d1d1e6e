"""What is shown of a run or a recording, thirty times a second, as foxglove.* messages."""

import time
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from stepbus_orchestrator.recording import PortInfo, Recording, Tail
from stepbus_schemas import Event
from stepbus_tools.viewing.exports.foxglove import SHOWN, Conversion
from stepbus_tools.viewing.foxglove_server import Row, Server
from stepbus_tools.viewing.history import History, timed_messages
from stepbus_tools.viewing.run_client import FRAME_S, RunClient, Turn, follow_run, latest_of
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.scene.scene import Messages, Scene

Happened = tuple[int, PortInfo, Event]
"""Time [ns], port and event."""


class Feed:
    """Converts what is new and publishes it; nothing while no client is connected.

    topics: of the ports that it shows, but for events.
    """

    def __init__(self, server: Server, scene: Scene, ports: Mapping[str, PortInfo]) -> None:
        self._server = server
        self._scene = scene
        self._shown = {p.topic: p for p in ports.values() if p.type in SHOWN}
        self._rows: list[Row] = []
        self._conversion = Conversion(scene, lambda *row: self._rows.append(row))
        self._poses = {frame.name: frame.pose for frame in scene.frames}
        self._steps: dict[str, int] = {}
        self._arrivals = 0
        events = {p.topic for p in self._shown.values() if p.type == "Event/1"}
        self.topics = scene.topics | (self._shown.keys() - events)

    def show(self, t_ns: int, step_ns: int, messages: Messages, events: Sequence[Happened]) -> None:
        """Publish what is new; all of it when a new client is connected.

        t_ns: simulation time [ns]. step_ns: length of a step [ns].
        """
        if not self._server.has_clients:
            return
        arrivals, is_first = self._server.arrivals, self._arrivals != self._server.arrivals
        if is_first:
            self._arrivals = arrivals
            self._steps.clear()
            self._conversion.bodies(t_ns)
        fresh = {t for t, latest in messages.items() if self._steps.get(t) != latest.step}
        self._steps |= {topic: messages[topic].step for topic in fresh}
        if is_first or fresh & self._scene.topics:
            self._poses |= self._scene.poses(messages)
            self._conversion.place(self._poses, t_ns)
        for topic in sorted(fresh & self._shown.keys()):
            latest = messages[topic]
            self._conversion.take(self._shown[topic], latest.message, latest.step * step_ns)
        for event_ns, port, event in events:
            self._conversion.take(port, event, event_ns)
        if self._rows:
            rows, self._rows = self._rows, []
            self._server.publish(t_ns, rows)


def follow(server: Server, folder: Path, is_over: Callable[[], bool]) -> bool:
    """Publish a run until it has ended, or the user ends this; returns whether the run has.

    folder, and what is raised: as of `follow_run`.
    """

    def begin(tail: Tail, _: RunClient) -> Turn:
        feed = Feed(server, build_scene(tail), tail.ports)
        ports = [port for port in tail.ports.values() if port.type == "Event/1"]
        tail.keep(port.topic for port in ports)

        def turn(_: bool) -> None:
            events = [
                (step * tail.step_ns, port, event)
                for port in ports
                for step, data in tail.take_kept(port.topic)
                if isinstance(event := tail.decode(port.topic, data), Event)
            ]
            feed.show(tail.t_ns, tail.step_ns, latest_of(tail, feed.topics), events)

        return turn

    return follow_run(folder, is_over, begin)


def play(
    server: Server, recording: Recording, is_over: Callable[[], bool], *, from_end: bool = False
) -> None:
    """Play a recording in real time to each new client, from its start; stay at its end.

    from_end: whether the connected clients have seen it.
    """
    history = History(recording)
    feed = Feed(server, build_scene(recording), recording.ports)
    server.forgets = True
    session = server.sessions if from_end else 0
    began_at, shown_ns = -history.end_ns * 1e-9, history.end_ns
    ports = recording.of_type("Event/1")
    events = [(t_ns, port, one) for port in ports for t_ns, one in timed_messages(port)]
    events.sort(key=_time)
    while not is_over():
        now = time.monotonic()
        if server.sessions != session:
            session, began_at, shown_ns = server.sessions, now, -1
        if server.has_clients:
            t_ns = min(round((now - began_at) * 1e9), history.end_ns)
            messages = history.at(feed.topics, t_ns)
            first, end = (bisect_right(events, t, key=_time) for t in (shown_ns, t_ns))
            feed.show(t_ns, history.step_ns, messages, events[first:end])
            shown_ns = t_ns
        time.sleep(max(0.0, FRAME_S - (time.monotonic() - now)))


def _time(event: Happened) -> int:
    return event[0]
