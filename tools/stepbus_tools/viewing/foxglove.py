"""foxglove.* messages, for a file or for the clients of a server."""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from stepbus_orchestrator.recording import Port, PortInfo, Recording, Tail
from stepbus_participant import need
from stepbus_schemas import Event, Image, JointReference, JointState, Message
from stepbus_tools.viewing.access import LOOPBACK, listening, shown_host
from stepbus_tools.viewing.history import History, timed_messages
from stepbus_tools.viewing.render import jpeg
from stepbus_tools.viewing.run_client import FRAME_S, RunClient, Turn, follow_run, latest_of
from stepbus_tools.viewing.scene.bodies import Messages
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.scene.pose import Pose
from stepbus_tools.viewing.scene.scene import Frame, Scene

PER_S = 30.0
"""Messages of each topic a second, at most; events are all there."""
SHOWN = ("Event/1", "Image/1", "JointReference/1", "JointState/1")
"""Types that are converted, beside those that move the scene."""
WORLD = "world"
_NS = 1_000_000_000

Happened = tuple[int, PortInfo, Event]
"""Time [ns], port and event."""


class Channels:
    """Writes messages to what is open in `context`: a file, or a server. topics: that it has.

    Raises ExtraMissing without foxglove-sdk.
    """

    def __init__(self) -> None:
        self.foxglove, self._channels = need("Foxglove", "foxglove", "foxglove.channels")
        self.context = self.foxglove.Context()
        self.topics: dict[str, Any] = {}

    def open(self, topic: str, kind: str) -> None:
        """Offer a topic for messages of a type, such as `Log`."""
        if topic not in self.topics:
            channel = getattr(self._channels, f"{kind}Channel")
            self.topics[topic] = channel(topic, context=self.context)

    def log(self, topic: str, message: Any, t_ns: int) -> None:
        """Write a foxglove message of a topic at a time [ns]."""
        self.open(topic, type(message).__name__)
        self.topics[topic].log(message, log_time=t_ns)


class Conversion:
    """Converts a scene and messages, and writes what they become.

    Raises ExtraMissing without foxglove-sdk or Pillow.
    """

    def __init__(self, scene: Scene, channels: Channels) -> None:
        (self._types,) = need("Foxglove", "foxglove.messages")
        self._emit = channels.log
        self._frames = [frame for frame in scene.frames if not frame.is_ghost]
        self._parents = {frame.name: frame.parent for frame in self._frames}

    def take(self, port: PortInfo, message: Message, t_ns: int) -> None:
        """Convert a message; one of another type becomes nothing."""
        match message:
            case JointState() | JointReference():
                self._emit(topic_of(port), self._joints(port, message, t_ns), t_ns)
            case Image():
                if (image := self._image(port, message, t_ns)) is not None:
                    self._emit(topic_of(port), image, t_ns)
            case Event():
                self._emit("/log", self._log(port, message, t_ns), t_ns)

    def place(self, placed: Mapping[str, Pose], t_ns: int) -> None:
        """Convert where frames are in their parents; ghosts have no place."""
        types = self._types
        rows = [
            types.FrameTransform(
                timestamp=self._stamp(t_ns),
                parent_frame_id=self._parents[name] or WORLD,
                child_frame_id=name,
                translation=types.Vector3(**_xyz(pose)),
                rotation=types.Quaternion(**_xyzw(pose)),
            )
            for name, pose in placed.items()
            if name in self._parents
        ]
        self._emit("/tf", types.FrameTransforms(transforms=rows), t_ns)

    def bodies(self, t_ns: int = 0) -> None:
        """Convert what the frames look like; they keep their looks and move with their frames."""
        entities = [self._entity(frame, t_ns) for frame in self._frames if frame.visuals]
        self._emit("/scene", self._types.SceneUpdate(entities=entities), t_ns)

    def _entity(self, frame: Frame, t_ns: int) -> Any:
        return self._types.SceneEntity(
            timestamp=self._stamp(t_ns),
            frame_id=frame.name,
            id=frame.name,
            frame_locked=True,
            triangles=[self._triangles(visual) for visual in frame.visuals],
        )

    def _triangles(self, visual: Any) -> Any:
        types = self._types
        red, green, blue = (float(value) / 255 for value in visual.shown_color)
        points = visual.mesh.vertices.astype(float).tolist()
        return types.TriangleListPrimitive(
            pose=types.Pose(
                position=types.Vector3(**_xyz(visual.pose)),
                orientation=types.Quaternion(**_xyzw(visual.pose)),
            ),
            points=[types.Point3(x=x, y=y, z=z) for x, y, z in points],
            color=types.Color(r=red, g=green, b=blue, a=1.0),
            indices=visual.mesh.faces.ravel().tolist(),
        )

    def _joints(self, port: PortInfo, state: Message, t_ns: int) -> Any:
        columns = {key: getattr(state, key, None) for key in ("position", "velocity", "effort")}
        rows = [
            self._types.JointState(
                name=name,
                **{key: row[i] for key, row in columns.items() if row is not None and i < len(row)},
            )
            for i, name in enumerate(port.names)
        ]
        return self._types.JointStates(timestamp=self._stamp(t_ns), joints=rows)

    def _image(self, port: PortInfo, image: Image, t_ns: int) -> Any:
        """Return an image as JPEG; None where its bytes do not fit its size."""
        data = jpeg(image)
        return data and self._types.CompressedImage(
            timestamp=self._stamp(t_ns), frame_id=port.topic, data=data, format="jpeg"
        )

    def _log(self, port: PortInfo, event: Event, t_ns: int) -> Any:
        return self._types.Log(
            timestamp=self._stamp(t_ns),
            level=getattr(self._types.LogLevel, event.level.capitalize()),
            message=event.text,
            name=port.participant,
        )

    def _stamp(self, t_ns: int) -> Any:
        return self._types.Timestamp(sec=t_ns // _NS, nsec=t_ns % _NS)


class Server:
    """The server of foxglove-sdk. sessions: how often a client came when there was no other.

    arrivals: how often a client has subscribed to something. Raises WiringError for a port that is
    taken or an address that is not of this machine, ExtraMissing without foxglove-sdk.
    """

    def __init__(self, name: str, *, host: str = LOOPBACK, port: int = 0) -> None:
        self.channels = Channels()
        self.sessions = self.arrivals = 0
        self._subscribed: set[tuple[int, int]] = set()
        # The library does not say what is wrong with a port or a host.
        listening(host, port).close()
        foxglove = self.channels.foxglove
        self._server = foxglove.start_server(
            name=name,
            host=host,
            port=port,
            capabilities=[foxglove.Capability.Time],
            server_listener=self,
            context=self.channels.context,
        )
        self.address = f"ws://{shown_host(host)}:{self._server.port}"

    @property
    def has_clients(self) -> bool:
        """Return whether anything is subscribed to."""
        return bool(self._subscribed)

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Note that a client wants all that is there (called by foxglove-sdk)."""
        self.sessions += not self._subscribed
        self.arrivals += 1
        self._subscribed.add((client.id, channel.id))

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Note that a client has gone (called by foxglove-sdk)."""
        self._subscribed.discard((client.id, channel.id))

    def tell(self, t_ns: int) -> None:
        """Tell clients the time [ns]."""
        self._server.broadcast_time(t_ns)

    def close(self) -> None:
        """Disconnect every client."""
        self._server.stop()


class Feed:
    """Sends what is new; all of it where a client has come. topics: that it shows, but events."""

    def __init__(self, server: Server, scene: Scene, ports: Mapping[str, PortInfo]) -> None:
        self._server = server
        self._scene = scene
        self._shown = {p.topic: p for p in ports.values() if p.type in SHOWN}
        self._conversion = Conversion(scene, server.channels)
        # Who subscribes after the first event would not get it.
        server.channels.open("/log", "Log")
        self._poses = {frame.name: frame.pose for frame in scene.frames}
        self._steps: dict[str, int] = {}
        self._arrivals = -1
        events = {p.topic for p in self._shown.values() if p.type == "Event/1"}
        self.topics = scene.topics | (self._shown.keys() - events)

    def show(self, t_ns: int, step_ns: int, messages: Messages, events: Sequence[Happened]) -> None:
        """Send what is new. t_ns: simulation time [ns]. step_ns: length of a step [ns]."""
        is_first = self._arrivals != self._server.arrivals
        if is_first:
            self._arrivals = self._server.arrivals
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
        self._server.tell(t_ns)


def follow(server: Server, folder: Path, is_over: Callable[[], bool]) -> bool:
    """Publish a run until it has ended, or the user ends this; returns whether the run has.

    folder, and what is raised: as of `follow_run`.
    """

    def begin(tail: Tail, _: RunClient) -> Turn:
        feed = Feed(server, build_scene(tail), tail.ports)
        ports = [port for port in tail.ports.values() if port.type == "Event/1"]
        tail.keep(port.topic for port in ports)

        def turn(_: bool) -> None:
            events = [row for port in ports for row in _happened(tail, port)]
            feed.show(tail.t_ns, tail.step_ns, latest_of(tail, feed.topics), events)

        return turn

    return follow_run(folder, is_over, begin)


def _happened(tail: Tail, port: PortInfo) -> Iterator[Happened]:
    for step, data in tail.take_kept(port.topic):
        message = tail.decode(port.topic, data)
        if isinstance(message, Event):
            yield step * tail.step_ns, port, message


def play(server: Server, recording: Recording, is_over: Callable[[], bool]) -> None:
    """Play a recording in real time, from its start for each client that finds no other."""
    history = History(recording)
    feed = Feed(server, build_scene(recording), recording.ports)
    session, began_at, events = -1, 0.0, _events(recording)
    happened = next(events, None)
    while not is_over():
        now = time.monotonic()
        if server.sessions != session:
            session, began_at, events = server.sessions, now, _events(recording)
            happened = next(events, None)
        t_ns = min(round((now - began_at) * 1e9), history.end_ns)
        due = list[Happened]()
        while happened is not None and happened[0] <= t_ns:
            due.append(happened)
            happened = next(events, None)
        feed.show(t_ns, history.step_ns, history.at(feed.topics, t_ns), due)
        time.sleep(max(0.0, FRAME_S - (time.monotonic() - now)))


def _events(recording: Recording) -> Iterator[Happened]:
    """Yield the events of a recording in the order of time."""

    def rows(port: Port) -> Iterator[Happened]:
        return ((t_ns, port, message) for t_ns, message in timed_messages(port))

    return heapq.merge(*map(rows, recording.of_type("Event/1")), key=lambda row: row[0])


def topic_of(port: PortInfo) -> str:
    """Return the topic of a port."""
    return f"/{port.topic}"


def _xyz(pose: Pose) -> dict[str, float]:
    return dict(zip("xyz", pose.position, strict=True))


def _xyzw(pose: Pose) -> dict[str, float]:
    return dict(zip("wxyz", pose.wxyz, strict=True))
