"""A scene: frames with what they look like, and where they are when messages say so."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from stepbus_schemas import Message
from stepbus_tools.viewing.scene.primitives import Pose

from .meshes import Visual
from .model import Model

if TYPE_CHECKING:
    from .motions import Modelled

GHOST = "target"
"""Prefix of the frames that show where joints should be."""


@dataclass(frozen=True, kw_only=True)
class Latest:
    """The newest message of a port: its step, and itself."""

    step: int
    message: Message


Messages = Mapping[str, Latest]
"""Topic → its newest message, of the ports that have one."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A frame: its parent, where it is at the start, and what it looks like.

    name: unique. parent: name of a frame that precedes it; empty: the world. label: for the
    reader. is_ghost: shows where something should be, not where it is.
    """

    name: str
    parent: str = ""
    pose: Pose = field(default_factory=Pose)
    visuals: tuple[Visual, ...] = ()
    label: str = ""
    body: str = ""
    is_ghost: bool = False


class Motion(Protocol):
    """Moves some frames of a scene."""

    @property
    def topics(self) -> frozenset[str]:
        """Return the ports that it reads."""

    def poses(self, messages: Messages) -> Mapping[str, Pose]:
        """Return frame → its pose in its parent, of the frames that the messages place."""


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
    shown as it is, a sentence each.

    bodies: those with a model.
    """

    frames: Sequence[Frame]
    motions: Sequence[Motion]
    chains: Sequence[Chain] = ()
    notes: Sequence[str] = ()
    bodies: "Sequence[Modelled]" = ()

    @property
    def topics(self) -> frozenset[str]:
        """Return the ports that move it."""
        return frozenset[str]().union(*(motion.topics for motion in self.motions))

    def poses(self, messages: Messages) -> dict[str, Pose]:
        """Return frame → its pose in its parent, of the frames that the messages place."""
        poses: dict[str, Pose] = {}
        for motion in self.motions:
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
