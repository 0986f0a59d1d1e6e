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


MESSAGE_TYPES: dict[str, type[Message]] = {
    "ControllerStatus/1": ControllerStatus,
    "Event/1": Event,
    "JointCommand/1": JointCommand,
    "JointReference/1": JointReference,
    "JointState/1": JointState,
}
