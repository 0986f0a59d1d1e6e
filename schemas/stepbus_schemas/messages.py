"""Version 1 of the messages that travel between ports.

SI units throughout. Every vector is in the order of `names` in the port's description. A field may
be added with a default; any other change is a new major version and a new row in `MESSAGE_TYPES`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec


def _vector(text: str, unit: str) -> Any:
    """Return the metadata of a vector with one entry per name of the port's description."""
    extra = {"unit": unit, "shape": ["n"]}
    return msgspec.Meta(description=text, extra_json_schema=extra)


class Message(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """What every port message is: an immutable, typed MessagePack map."""


class JointState(Message, frozen=True):
    """What the joints do now, each quantity optional as sensed."""

    position: Annotated[list[float] | None, _vector("measured positions", "rad")] = None
    velocity: Annotated[list[float] | None, _vector("measured velocities", "rad/s")] = None
    effort: Annotated[list[float] | None, _vector("torques the motors applied", "N·m")] = None
    target: Annotated[list[float] | None, _vector("newest position targets", "rad")] = None


JointMode = Literal["torque", "velocity", "position", "teleport", "brake"]


class JointCommand(Message, frozen=True):
    """What the joints shall do from this step on."""

    mode: Annotated[JointMode, msgspec.Meta(description="what `values` mean")]
    values: Annotated[
        list[float],
        _vector(
            "torque, velocity, position, position to jump to; mode brake does not read them",
            "N·m, rad/s, rad, rad, -",
        ),
    ]
    velocity: Annotated[
        list[float] | None,
        _vector("feed-forward of mode position; start velocity of mode teleport", "rad/s"),
    ] = None
    effort_limit: Annotated[
        list[float] | None, _vector("largest torque of modes velocity and position", "N·m")
    ] = None


class JointReference(Message, frozen=True):
    """Where the joints should be, with exact derivatives."""

    position: Annotated[list[float], _vector("desired positions", "rad")]
    velocity: Annotated[list[float], _vector("desired velocities", "rad/s")]
    acceleration: Annotated[list[float], _vector("desired accelerations", "rad/s²")]


class ControllerStatus(Message, frozen=True):
    """How well the controller does."""

    error: Annotated[list[float], _vector("reference minus measured position", "rad")]
    saturated: Annotated[list[bool], _vector("whether the command was cut at its limit", "-")]
    warnings: Annotated[list[str], msgspec.Meta(description="what the controller complains of")] = (
        msgspec.field(default_factory=list)
    )


class Event(Message, frozen=True):
    """A sentence for whoever watches the run."""

    level: Annotated[
        Literal["info", "warning", "error"], msgspec.Meta(description="how much it matters")
    ]
    text: Annotated[str, msgspec.Meta(description="one sentence")]


GoalKind = Literal["move_joints", "move_to_pose", "stop"]
Point = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Goal(Message, frozen=True):
    """What the mission wants a controller to bring about; it may take many steps."""

    id: Annotated[
        int, msgspec.Meta(ge=0, description="of the goal; another one ends the goal before it")
    ]
    kind: Annotated[
        GoalKind,
        msgspec.Meta(description="what shall happen; `stop`: come to rest, end the goal before it"),
    ]
    joints: Annotated[list[str], msgspec.Meta(description="of kind move_joints: those to move")] = (
        msgspec.field(default_factory=list)
    )
    values: Annotated[
        list[float],
        msgspec.Meta(
            description="of kind move_joints: where to, in the order of `joints`",
            extra_json_schema={"unit": "rad", "shape": ["joints"]},
        ),
    ] = msgspec.field(default_factory=list)
    tip: Annotated[
        str,
        msgspec.Meta(description="of kind move_to_pose: frame of the robot that shall go there"),
    ] = ""
    position: Annotated[
        Point | None,
        msgspec.Meta(
            description="of kind move_to_pose: x, y, z of the tip", extra_json_schema={"unit": "m"}
        ),
    ] = None
    orientation: Annotated[
        Quaternion | None,
        msgspec.Meta(
            description="of kind move_to_pose: quaternion x, y, z, w of the tip",
            extra_json_schema={"unit": "-"},
        ),
    ] = None
    frame: Annotated[
        str, msgspec.Meta(description="that the pose is given in; empty: the robot's base")
    ] = ""
    duration: Annotated[
        float,
        msgspec.Meta(
            description="of the motion, where the limits allow it; 0: as fast as they allow",
            extra_json_schema={"unit": "s"},
        ),
    ] = 0.0


GoalState = Literal["accepted", "running", "succeeded", "failed", "cancelled"]


class GoalStatus(Message, frozen=True):
    """What has become of a goal; published when it changes."""

    id: Annotated[int, msgspec.Meta(ge=0, description="of the goal")]
    state: Annotated[GoalState, msgspec.Meta(description="where it stands")]
    cause: Annotated[
        str,
        msgspec.Meta(
            description="one word for programs: why it failed, or why it may; empty: all is well"
        ),
    ] = ""
    text: Annotated[str, msgspec.Meta(description="one sentence for people, with numbers")] = ""


class Poses(Message, frozen=True):
    """Where named links truly are, in the frame of the world."""

    position: Annotated[
        list[Point],
        msgspec.Meta(
            description="x, y, z of each", extra_json_schema={"unit": "m", "shape": ["n", "3"]}
        ),
    ]
    orientation: Annotated[
        list[Quaternion],
        msgspec.Meta(
            description="quaternion x, y, z, w of each",
            extra_json_schema={"unit": "-", "shape": ["n", "4"]},
        ),
    ]


MESSAGE_TYPES: dict[str, type[Message]] = {
    "ControllerStatus/1": ControllerStatus,
    "Event/1": Event,
    "Goal/1": Goal,
    "GoalStatus/1": GoalStatus,
    "JointCommand/1": JointCommand,
    "JointReference/1": JointReference,
    "JointState/1": JointState,
    "Poses/1": Poses,
}
