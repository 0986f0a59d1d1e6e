"""A body with a model, and where messages say that it is: joints, true poses, odometry."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from stepbus_schemas import (
    BaseState,
    GripperState,
    JointCommand,
    JointReference,
    JointState,
    Message,
    Poses,
)
from stepbus_tools.viewing.scene.pose import Pose, about, from_xyzw

from .model import Model


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
