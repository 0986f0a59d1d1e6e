"""A scene: frames with what they look like, and where they are when messages say so."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import NamedTuple

from stepbus_models import Joint
from stepbus_schemas import (
    BaseState,
    GripperState,
    JointCommand,
    JointReference,
    JointState,
    Message,
    Poses,
)
from stepbus_tools.viewing.scene.meshes import Visual
from stepbus_tools.viewing.scene.model import Model
from stepbus_tools.viewing.scene.pose import Pose, about, from_xyzw


class Latest(NamedTuple):
    """The newest message of a port: its step, and itself."""

    step: int
    message: Message


Messages = Mapping[str, Latest]
"""Topic → its newest message, of the ports that have one."""


@dataclass(frozen=True, kw_only=True)
class JointSource:
    """A port that says where joints are, or should be. names: of its vectors."""

    topic: str
    names: Sequence[str]

    def positions(self, messages: Messages) -> Mapping[str, float]:
        """Return joint → its position [rad or m]; nothing where the message does not say."""
        latest = messages.get(self.topic)
        values = None if latest is None else positions_in(latest.message)
        if values is None or len(values) != len(self.names):
            return {}
        rows = zip(self.names, values, strict=True)
        return {name: value for name, value in rows if math.isfinite(value)}


def positions_in(message: Message) -> Sequence[float] | None:
    """Return the positions of joints that a message reports or asks for; None where it has none."""
    match message:
        case JointState() | JointReference():
            return message.position
        case GripperState():
            return [message.width / 2, message.width / 2]
        case JointCommand() if message.mode in {"position", "teleport"}:
            return message.values
    return None


def all_positions(sources: Sequence[JointSource], messages: Messages) -> dict[str, float]:
    """Return where joints are by all sources; the first one that knows a joint counts."""
    positions: dict[str, float] = {}
    for source in reversed(sources):
        positions |= source.positions(messages)
    return positions


@dataclass(frozen=True, kw_only=True)
class Body:
    """A body of a world, and the ports that know where it is.

    name: as in descriptions of poses. start: pose of its root in the world. is_fixed: whether the
    root stays there. measured: what measures its joints, the best one first. links: link of the
    model → topics with its true pose in the world, and its number there. odometry: topic of its
    BaseState; empty: none.
    """

    name: str
    model: Model
    start: Pose = field(default_factory=Pose)
    is_fixed: bool = False
    measured: Sequence[JointSource] = ()
    links: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    odometry: str = ""

    @property
    def anchor(self) -> str:
        """Return the link nearest to the root whose true pose is known; empty without any."""
        below = (self.model.root, *(joint.child for joint in self.model.joints))
        return next((name for name in below if name in self.links), "")

    def in_world(self, link: str, messages: Messages) -> Pose | None:
        """Return the true pose of a link; None where no message has it."""
        known = [topic for topic in self.links.get(link, ()) if topic in messages]
        if not known:
            return None
        newest = max(known, key=lambda name: messages[name].step)
        message, number = messages[newest].message, self.links[link][newest]
        if not isinstance(message, Poses) or number >= len(message.position):
            return None
        return from_xyzw(message.position[number], message.orientation[number])

    def root_in_world(self, messages: Messages) -> Pose | None:
        """Return the true pose of the root; None where no message has that of a link."""
        pose = self.in_world(self.anchor, messages)
        if pose is None:
            return None
        positions = all_positions(self.measured, messages)
        return pose @ self.model.pose(self.anchor, positions).inverse()

    def root_in_odom(self, messages: Messages) -> Pose | None:
        """Return where odometry says the root is, seen from its start; None where it does not."""
        latest = messages.get(self.odometry)
        state = None if latest is None else latest.message
        if not isinstance(state, BaseState):
            return None
        if not all(map(math.isfinite, (state.x, state.y, state.yaw))):
            return None
        return Pose((state.x, state.y, 0.0), about((0.0, 0.0, 1.0), state.yaw))


GHOST = "target"
"""Prefix of the frames that show where joints should be."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A frame: its parent, where it is at the start, and what it looks like.

    name: unique. parent: name of a frame that precedes it; empty: the world. ghost_of: the frame
    that is where this one shows that it should be; empty of others.
    """

    name: str
    parent: str = ""
    pose: Pose = field(default_factory=Pose)
    visuals: tuple[Visual, ...] = ()
    body: str = ""
    ghost_of: str = ""

    @property
    def is_ghost(self) -> bool:
        """Return whether it shows where something should be, not where it is."""
        return bool(self.ghost_of)


class LinkMotion:
    """Places links where ports of type Poses/1 say. ports: topic → frame of each of its links."""

    def __init__(self, ports: Mapping[str, Sequence[str | None]]) -> None:
        self._ports = ports
        self.topics = frozenset(ports)

    def poses(self, messages: Messages) -> Mapping[str, Pose]:
        """Return the newest pose of each link; nothing of a message that does not fit."""
        poses: dict[str, Pose] = {}
        known = [topic for topic in self._ports if topic in messages]
        for topic in sorted(known, key=lambda name: messages[name].step):
            message, frames = messages[topic].message, self._ports[topic]
            if isinstance(message, Poses) and len(message.position) == len(frames):
                rows = zip(frames, message.position, message.orientation, strict=True)
                poses |= {frame: from_xyzw(p, q) for frame, p, q in rows if frame is not None}
        return poses


class BodyMotion:
    """Moves the links of a body by its joints, its root by its true pose, or by odometry.

    prefix: of its frames. sources: that know joints, the best one first. joints: those that move.
    """

    def __init__(
        self, body: Body, prefix: str, sources: Sequence[JointSource], joints: Sequence[Joint]
    ) -> None:
        self._body = body
        self._prefix = prefix
        self._sources = sources
        self._joints = joints
        self._has_root = bool(body.anchor or body.odometry)
        topics = {source.topic for source in sources} if joints else set[str]()
        if self._has_root:
            topics |= {*body.links.get(body.anchor, ()), body.odometry} - {""}
            topics |= {source.topic for source in body.measured}
        self.topics = frozenset(topics)

    def poses(self, messages: Messages) -> Mapping[str, Pose]:
        """Return the pose of the root, and of each link that a joint moves, in its parent."""
        body, prefix = self._body, self._prefix
        positions = all_positions(self._sources, messages)
        poses = {
            prefix + joint.child: body.model.placed(joint, positions) for joint in self._joints
        }
        root = body.root_in_world(messages) if self._has_root else None
        if root is None and (moved := body.root_in_odom(messages)) is not None:
            root = body.start @ moved
        return poses if root is None else {**poses, prefix + body.model.root: root}


@dataclass(frozen=True, kw_only=True)
class Chain:
    """The joints that a planned path is of. root: frame of the model's root. tip: a link."""

    topic: str
    names: Sequence[str]
    model: Model
    root: str
    tip: str


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A scene.

    frames: parents first. chains: of the ports that carry planned paths. notes: what cannot be
    shown as it is, a sentence each. bodies: those with a model.
    """

    frames: Sequence[Frame]
    motions: Sequence[LinkMotion | BodyMotion] = ()
    chains: Sequence[Chain] = ()
    notes: Sequence[str] = ()
    bodies: Sequence[Body] = ()

    @property
    def has_looks(self) -> bool:
        """Return whether there is anything to draw."""
        return any(frame.visuals for frame in self.frames)

    @property
    def topics(self) -> frozenset[str]:
        """Return the ports that move it."""
        return frozenset(chain.from_iterable(motion.topics for motion in self.motions))

    def poses(self, messages: Messages, topics: frozenset[str] | None = None) -> dict[str, Pose]:
        """Return frame → its pose in its parent, of the frames that the messages place.

        topics: place only what these move.
        """
        poses: dict[str, Pose] = {}
        for motion in self.motions:
            if topics is None or not topics.isdisjoint(motion.topics):
                poses |= motion.poses(messages)
        return poses

    def world_poses(self, messages: Messages) -> dict[str, Pose]:
        """Return frame → its pose in the world, of all frames."""
        return self.placed(self.poses(messages))

    def placed(self, moved: Mapping[str, Pose]) -> dict[str, Pose]:
        """Return frame → its pose in the world. moved: frame → its pose in its parent."""
        poses = dict[str, Pose]()
        for frame in self.frames:
            pose = moved.get(frame.name, frame.pose)
            poses[frame.name] = poses[frame.parent] @ pose if frame.parent else pose
        return poses
