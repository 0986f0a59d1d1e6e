"""How messages move frames: poses of links, states and targets of joints, odometry of a base."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from stepbus_schemas import (
    BaseState,
    GripperState,
    JointCommand,
    JointReference,
    JointState,
    Message,
    Poses,
)
from stepbus_tools.viewing.scene.primitives import Pose, about, from_xyzw

from .model import Joint, Model
from .scene import Messages

Positions = Mapping[str, float]
"""Joint → its position [rad or m]."""
Reader = Callable[[Message], Sequence[float] | None]
"""Returns the positions in a message; None where it has none."""


@dataclass(frozen=True, kw_only=True)
class JointSource:
    """A port that says where joints are. names: of its vectors."""

    topic: str
    names: Sequence[str]
    read: Reader

    def positions(self, messages: Messages) -> Positions:
        """Return where its joints are; nothing where the message does not say."""
        latest = messages.get(self.topic)
        values = None if latest is None else self.read(latest.message)
        if values is None or len(values) != len(self.names):
            return {}
        return {
            name: value
            for name, value in zip(self.names, values, strict=True)
            if math.isfinite(value)
        }


def measured(message: Message) -> Sequence[float] | None:
    """Return the positions that a message reports."""
    if isinstance(message, JointState):
        return message.position
    if isinstance(message, GripperState):
        return [message.width / 2, message.width / 2]
    return None


def wanted(message: Message) -> Sequence[float] | None:
    """Return the positions that a message asks for."""
    if isinstance(message, JointReference):
        return message.position
    if isinstance(message, JointCommand) and message.mode in {"position", "teleport"}:
        return message.values
    return None


def all_positions(sources: Sequence[JointSource], messages: Messages) -> Positions:
    """Return where joints are by all sources; the first one that knows a joint counts."""
    positions: dict[str, float] = {}
    for source in reversed(sources):
        positions |= source.positions(messages)
    return positions


@dataclass(frozen=True, kw_only=True)
class LinkMotion:
    """Places links where ports of type Poses/1 say. ports: topic → frame of each of its links."""

    ports: Mapping[str, Sequence[str | None]]
    topics: frozenset[str] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "topics", frozenset(self.ports))

    def poses(self, messages: Messages) -> Mapping[str, Pose]:
        """Return the newest pose of each link."""
        poses: dict[str, Pose] = {}
        known = [topic for topic in self.ports if topic in messages]
        for topic in sorted(known, key=lambda name: messages[name].step):
            poses |= link_poses(self.ports[topic], messages[topic].message)
        return poses


def link_poses(frames: Sequence[str | None], message: Message) -> dict[str, Pose]:
    """Return frame → pose, of a message of type Poses/1 that fits."""
    if not isinstance(message, Poses) or len(message.position) != len(frames):
        return {}
    rows = zip(frames, message.position, message.orientation, strict=True)
    return {frame: from_xyzw(p, q) for frame, p, q in rows if frame is not None}


@dataclass(frozen=True, kw_only=True)
class JointMotion:
    """Moves the links of a model by its joints.

    prefix: of its frames. sources: that know joints, the best one first. joints: those that move.
    """

    model: Model
    prefix: str
    sources: Sequence[JointSource]
    joints: Sequence[Joint]
    topics: frozenset[str] = field(init=False)

    def __post_init__(self) -> None:
        topics = frozenset(source.topic for source in self.sources)
        object.__setattr__(self, "topics", topics)

    def poses(self, messages: Messages) -> Mapping[str, Pose]:
        """Return the pose of each link that a joint moves, in the link before it."""
        positions = all_positions(self.sources, messages)
        return {
            self.prefix + joint.child: joint.at(self.model.position(joint, positions))
            for joint in self.joints
        }


@dataclass(frozen=True, kw_only=True)
class Modelled:
    """A body with a model, and the ports that know where it is.

    start: pose of its root in the world. is_fixed: whether the root stays there. sources: ports
    that measure its joints, the best one first. links: link of the model → topics with its true
    pose in the world, and its number there. odometry: topic of its BaseState; empty: none.
    """

    name: str
    model: Model
    start: Pose
    is_fixed: bool
    sources: Sequence[JointSource]
    links: Mapping[str, Mapping[str, int]]
    odometry: str = ""

    @property
    def anchor(self) -> str:
        """Return the link nearest to the root whose true pose is known; empty without any."""
        return next((name for name in self.model.below_root if name in self.links), "")

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
        positions = all_positions(self.sources, messages)
        return pose @ self.model.pose(self.anchor, positions).inverse()

    def root_in_odom(self, messages: Messages) -> Pose | None:
        """Return where odometry says the root is, seen from its start; None where it does not."""
        latest = messages.get(self.odometry)
        if latest is None or not isinstance(latest.message, BaseState):
            return None
        state = latest.message
        if not all(map(math.isfinite, (state.x, state.y, state.yaw))):
            return None
        return Pose((state.x, state.y, 0.0), about((0.0, 0.0, 1.0), state.yaw))


@dataclass(frozen=True, kw_only=True)
class RootMotion:
    """Places the root of a body by its true pose, or by odometry. frame: of the root."""

    frame: str
    body: Modelled
    topics: frozenset[str] = field(init=False)

    def __post_init__(self) -> None:
        body = self.body
        truth = body.links.get(body.anchor, {})
        measured_by = {source.topic for source in body.sources}
        odometry = {body.odometry} - {""}
        object.__setattr__(self, "topics", frozenset({*truth, *measured_by, *odometry}))

    def poses(self, messages: Messages) -> Mapping[str, Pose]:
        """Return the pose of the root."""
        pose = self.body.root_in_world(messages)
        if pose is None and (moved := self.body.root_in_odom(messages)) is not None:
            pose = self.body.start @ moved
        return {} if pose is None else {self.frame: pose}
