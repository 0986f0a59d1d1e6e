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


GoalType = Literal[
    "move_joints",
    "move_to_pose",
    "move_linear",
    "spiral",
    "drive",
    "turn",
    "go_to",
    "grip",
    "stop",
]
Point = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Spiral(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """A way around a vertical axis, narrowing while it rises."""

    centre: Annotated[
        Point,
        msgspec.Meta(
            description="x, y, z of the axis at the height of the beginning",
            extra_json_schema={"unit": "m"},
        ),
    ]
    radius: Annotated[
        tuple[float, float],
        msgspec.Meta(
            description="at the beginning and at the end",
            extra_json_schema={"unit": "m", "shape": ["2"]},
        ),
    ]
    turns: Annotated[float, msgspec.Meta(description="how many, counter-clockwise")]
    rise: Annotated[
        float,
        msgspec.Meta(description="height gained on the way", extra_json_schema={"unit": "m"}),
    ] = 0.0


class Goal(Message, frozen=True):
    """What the mission wants a controller to bring about; it may take many steps."""

    id: Annotated[
        int, msgspec.Meta(ge=0, description="of the goal; another one ends the goal before it")
    ]
    type: Annotated[
        GoalType,
        msgspec.Meta(description="what shall happen; `stop`: come to rest, end the goal before it"),
    ]
    joints: Annotated[list[str], msgspec.Meta(description="of type move_joints: those to move")] = (
        msgspec.field(default_factory=list)
    )
    values: Annotated[
        list[float],
        msgspec.Meta(
            description="of type move_joints: where to, in the order of `joints`",
            extra_json_schema={"unit": "rad", "shape": ["joints"]},
        ),
    ] = msgspec.field(default_factory=list)
    tip: Annotated[
        str,
        msgspec.Meta(
            description="of types move_to_pose, move_linear, spiral: frame of the robot that goes"
        ),
    ] = ""
    position: Annotated[
        Point | None,
        msgspec.Meta(
            description="of these types: x, y, z where the tip shall be in the end",
            extra_json_schema={"unit": "m"},
        ),
    ] = None
    orientation: Annotated[
        Quaternion | None,
        msgspec.Meta(
            description="of these types: quaternion x, y, z, w of the tip in the end",
            extra_json_schema={"unit": "-"},
        ),
    ] = None
    frame: Annotated[
        str,
        msgspec.Meta(
            description="that the pose is given in: a link, `odometry`; empty: the robot's base"
        ),
    ] = ""
    duration: Annotated[
        float,
        msgspec.Meta(
            description="of the motion, where the limits allow it; 0: as fast as they allow",
            extra_json_schema={"unit": "s"},
        ),
    ] = 0.0
    touches: Annotated[
        list[str],
        msgspec.Meta(description="links of the world that the robot may touch on the way"),
    ] = msgspec.field(default_factory=list)
    by: Annotated[
        float,
        msgspec.Meta(
            description="of type drive: how far ahead; of type turn: angle, counter-clockwise",
            extra_json_schema={"unit": "m, rad"},
        ),
    ] = 0.0
    base: Annotated[
        Point | None,
        msgspec.Meta(
            description="of type go_to: x, y, yaw of the base in the frame of odometry",
            extra_json_schema={"unit": "m, m, rad"},
        ),
    ] = None
    width: Annotated[
        float,
        msgspec.Meta(description="of type grip: between the pads", extra_json_schema={"unit": "m"}),
    ] = 0.0
    force: Annotated[
        float,
        msgspec.Meta(
            description="of type grip: largest one of each finger", extra_json_schema={"unit": "N"}
        ),
    ] = 0.0
    spiral: Annotated[
        Spiral | None,
        msgspec.Meta(description="of type spiral: the way to position and orientation"),
    ] = None


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


def _scalar(text: str, unit: str) -> Any:
    """Return the metadata of a single quantity."""
    return msgspec.Meta(description=text, extra_json_schema={"unit": unit})


class BaseState(Message, frozen=True):
    """Where a mobile base believes to be, from the turning of its wheels alone.

    The frame of odometry is where the base stood and looked at the start: x ahead, y to the left.
    """

    x: Annotated[float, _scalar("in the frame of odometry", "m")]
    y: Annotated[float, _scalar("in the frame of odometry", "m")]
    yaw: Annotated[float, _scalar("turned since the start, counter-clockwise, not wrapped", "rad")]
    vx: Annotated[float, _scalar("forward velocity, in the base frame", "m/s")]
    wz: Annotated[float, _scalar("turning velocity, counter-clockwise", "rad/s")]


class BaseCommand(Message, frozen=True):
    """How a mobile base shall move from this step on; without any field it shall stand."""

    vx: Annotated[float, _scalar("forward velocity, in the base frame", "m/s")] = 0.0
    wz: Annotated[float, _scalar("turning velocity, counter-clockwise", "rad/s")] = 0.0
    wheels: Annotated[
        tuple[float, float] | None,
        msgspec.Meta(
            description="velocities of the left and right wheel, instead of vx and wz",
            extra_json_schema={"unit": "rad/s", "shape": ["2"]},
        ),
    ] = None


class GripperState(Message, frozen=True):
    """What a gripper with two fingers does now."""

    width: Annotated[float, _scalar("between the pads", "m")]
    force: Annotated[float, _scalar("with which the weaker finger presses on things", "N")]
    holding: Annotated[
        bool,
        msgspec.Meta(description="whether both fingers press on the same thing from two sides"),
    ]


class GripperCommand(Message, frozen=True):
    """How wide a gripper shall be, and how hard it may press to get there."""

    width: Annotated[float, _scalar("to reach between the pads", "m")]
    force: Annotated[float, _scalar("largest one of each finger, ≥ 0", "N")]


class Contacts(Message, frozen=True):
    """Which links touch; one entry per pair of links, in the order of their names."""

    pairs: Annotated[
        list[tuple[str, str]],
        msgspec.Meta(description="names of two links", extra_json_schema={"shape": ["k", "2"]}),
    ]
    force: Annotated[
        list[float],
        msgspec.Meta(
            description="normal force between them, over all their points",
            extra_json_schema={"unit": "N", "shape": ["k"]},
        ),
    ]
    distance: Annotated[
        list[float],
        msgspec.Meta(
            description="smallest gap between them; below 0: how deep they are in one another",
            extra_json_schema={"unit": "m", "shape": ["k"]},
        ),
    ]
    position: Annotated[
        list[Point],
        msgspec.Meta(
            description="where that gap is: x, y, z on the second link, in the frame of the world",
            extra_json_schema={"unit": "m", "shape": ["k", "3"]},
        ),
    ]


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


class Image(Message, frozen=True):
    """A camera frame; the optical frame looks along z, x to the right, y down."""

    width: Annotated[int, msgspec.Meta(ge=0, description="pixels in a row")]
    height: Annotated[int, msgspec.Meta(ge=0, description="rows")]
    encoding: Annotated[
        Literal["rgb8", "32FC1"],
        msgspec.Meta(
            description="of a pixel: red, green, blue bytes; or depth along z, float32 LE [m]"
        ),
    ]
    data: Annotated[bytes, msgspec.Meta(description="the pixels, row by row from the top left")]
    focal: Annotated[
        tuple[float, float],
        msgspec.Meta(
            description="focal length in x and y",
            extra_json_schema={"unit": "pixel", "shape": ["2"]},
        ),
    ]
    centre: Annotated[
        tuple[float, float],
        msgspec.Meta(
            description="where the optical axis meets the image: x, y",
            extra_json_schema={"unit": "pixel", "shape": ["2"]},
        ),
    ]


class Detections(Message, frozen=True):
    """What was found in a camera frame, one entry per item."""

    frame: Annotated[str, msgspec.Meta(description="link that the poses are given in")]
    types: Annotated[
        list[str],
        msgspec.Meta(description="what each item is", extra_json_schema={"shape": ["k"]}),
    ]
    position: Annotated[
        list[Point],
        msgspec.Meta(
            description="x, y, z of the centre of each",
            extra_json_schema={"unit": "m", "shape": ["k", "3"]},
        ),
    ]
    orientation: Annotated[
        list[Quaternion],
        msgspec.Meta(
            description="quaternion x, y, z, w of each; what cannot be seen of it is left at 0",
            extra_json_schema={"unit": "-", "shape": ["k", "4"]},
        ),
    ]
    confidence: Annotated[
        list[float],
        msgspec.Meta(
            description="0 to 1: how much of what should be visible was seen",
            extra_json_schema={"unit": "-", "shape": ["k"]},
        ),
    ]


class PlanRequest(Message, frozen=True):
    """Asks a planner for a way of the joints that touches nothing."""

    id: Annotated[int, msgspec.Meta(ge=0, description="of the request; published when it changes")]
    start: Annotated[list[float], _vector("where the joints are", "rad")]
    goal: Annotated[list[float], _vector("where they shall come to rest", "rad")]
    held: Annotated[
        str, msgspec.Meta(description="link of the world in the gripper; empty: none")
    ] = ""
    touches: Annotated[
        list[str], msgspec.Meta(description="links of the world that may be touched on the way")
    ] = msgspec.field(default_factory=list)


class Plan(Message, frozen=True):
    """A planner's answer: a timed motion from rest to rest, or why there is none."""

    id: Annotated[int, msgspec.Meta(ge=0, description="of the request")]
    cause: Annotated[
        str, msgspec.Meta(description="one word for programs: why there is none; empty: found")
    ] = ""
    text: Annotated[str, msgspec.Meta(description="one sentence for people, with numbers")] = ""
    times: Annotated[
        list[float],
        msgspec.Meta(
            description="since the beginning, from 0, increasing",
            extra_json_schema={"unit": "s", "shape": ["k"]},
        ),
    ] = msgspec.field(default_factory=list)
    position: Annotated[
        list[list[float]],
        msgspec.Meta(
            description="of the joints at each time",
            extra_json_schema={"unit": "rad", "shape": ["k", "n"]},
        ),
    ] = msgspec.field(default_factory=list)
    velocity: Annotated[
        list[list[float]],
        msgspec.Meta(
            description="of the joints at each time",
            extra_json_schema={"unit": "rad/s", "shape": ["k", "n"]},
        ),
    ] = msgspec.field(default_factory=list)


MESSAGE_TYPES: dict[str, type[Message]] = {
    "BaseCommand/1": BaseCommand,
    "BaseState/1": BaseState,
    "Contacts/1": Contacts,
    "ControllerStatus/1": ControllerStatus,
    "Detections/1": Detections,
    "Event/1": Event,
    "Goal/1": Goal,
    "GoalStatus/1": GoalStatus,
    "GripperCommand/1": GripperCommand,
    "GripperState/1": GripperState,
    "Image/1": Image,
    "JointCommand/1": JointCommand,
    "JointReference/1": JointReference,
    "JointState/1": JointState,
    "Plan/1": Plan,
    "PlanRequest/1": PlanRequest,
    "Poses/1": Poses,
}
