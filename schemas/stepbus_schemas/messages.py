"""Version 1 of the port messages.

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
    """Base of every port message: an immutable, typed MessagePack map."""


class JointState(Message, frozen=True):
    """Joint states; a quantity that is not sensed is absent."""

    position: Annotated[list[float] | None, _vector("measured positions", "rad")] = None
    velocity: Annotated[list[float] | None, _vector("measured velocities", "rad/s")] = None
    effort: Annotated[list[float] | None, _vector("torques applied by the motors", "N·m")] = None
    target: Annotated[list[float] | None, _vector("current position targets", "rad")] = None


JointMode = Literal["torque", "velocity", "position", "teleport", "brake"]


class JointCommand(Message, frozen=True):
    """Joint commands, valid from this step on."""

    mode: Annotated[JointMode, msgspec.Meta(description="meaning of `values`")]
    values: Annotated[
        list[float],
        _vector(
            "torque, velocity, position, or position to teleport to; unused in mode brake",
            "N·m, rad/s, rad, rad, -",
        ),
    ]
    velocity: Annotated[
        list[float] | None,
        _vector("feed-forward in mode position; initial velocity in mode teleport", "rad/s"),
    ] = None
    effort_limit: Annotated[
        list[float] | None, _vector("maximum torque in modes velocity and position", "N·m")
    ] = None


class JointReference(Message, frozen=True):
    """Reference trajectory of the joints, with exact derivatives."""

    position: Annotated[list[float], _vector("desired positions", "rad")]
    velocity: Annotated[list[float], _vector("desired velocities", "rad/s")]
    acceleration: Annotated[list[float], _vector("desired accelerations", "rad/s²")]


class ControllerStatus(Message, frozen=True):
    """Tracking status of a controller."""

    error: Annotated[list[float], _vector("reference minus measured position", "rad")]
    saturated: Annotated[list[bool], _vector("whether the command is saturated at its limit", "-")]
    warnings: Annotated[list[str], msgspec.Meta(description="warnings of the controller")] = (
        msgspec.field(default_factory=list)
    )


class Event(Message, frozen=True):
    """A sentence for the user, shown during the run."""

    level: Annotated[Literal["info", "warning", "error"], msgspec.Meta(description="severity")]
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
    """A spiral path around a vertical axis, which may narrow and rise."""

    centre: Annotated[
        Point,
        msgspec.Meta(
            description="point of the axis at the starting height: x, y, z",
            extra_json_schema={"unit": "m"},
        ),
    ]
    radius: Annotated[
        tuple[float, float],
        msgspec.Meta(
            description="radius at the start and at the end",
            extra_json_schema={"unit": "m", "shape": ["2"]},
        ),
    ]
    turns: Annotated[float, msgspec.Meta(description="number of turns, counter-clockwise")]
    rise: Annotated[
        float,
        msgspec.Meta(description="total rise along the path", extra_json_schema={"unit": "m"}),
    ] = 0.0


class Goal(Message, frozen=True):
    """A goal for a controller; it may take many steps."""

    id: Annotated[
        int, msgspec.Meta(ge=0, description="id of the goal; a new id replaces the current goal")
    ]
    type: Annotated[
        GoalType,
        msgspec.Meta(description="what to do; `stop`: come to rest and cancel the current goal"),
    ]
    joints: Annotated[
        list[str], msgspec.Meta(description="move_joints: names of the joints to move")
    ] = msgspec.field(default_factory=list)
    values: Annotated[
        list[float],
        msgspec.Meta(
            description="move_joints: target positions, in the order of `joints`",
            extra_json_schema={"unit": "rad", "shape": ["joints"]},
        ),
    ] = msgspec.field(default_factory=list)
    tip: Annotated[
        str,
        msgspec.Meta(description="move_to_pose, move_linear, spiral: frame of the robot to move"),
    ] = ""
    position: Annotated[
        Point | None,
        msgspec.Meta(
            description="move_to_pose, move_linear, spiral: target position of the tip: x, y, z",
            extra_json_schema={"unit": "m"},
        ),
    ] = None
    orientation: Annotated[
        Quaternion | None,
        msgspec.Meta(
            description="the same: target orientation of the tip, quaternion x, y, z, w",
            extra_json_schema={"unit": "-"},
        ),
    ] = None
    frame: Annotated[
        str,
        msgspec.Meta(
            description="reference frame of the pose: a link or `odometry`; empty: the robot's base"
        ),
    ] = ""
    duration: Annotated[
        float,
        msgspec.Meta(
            description="duration of the motion, if the limits allow it; 0: as fast as they allow",
            extra_json_schema={"unit": "s"},
        ),
    ] = 0.0
    touches: Annotated[
        list[str],
        msgspec.Meta(description="links of the world that the robot may touch during the motion"),
    ] = msgspec.field(default_factory=list)
    by: Annotated[
        float,
        msgspec.Meta(
            description="drive: distance ahead; turn: angle, counter-clockwise",
            extra_json_schema={"unit": "m, rad"},
        ),
    ] = 0.0
    base: Annotated[
        Point | None,
        msgspec.Meta(
            description="go_to: target x, y, yaw of the base in the odometry frame",
            extra_json_schema={"unit": "m, m, rad"},
        ),
    ] = None
    width: Annotated[
        float,
        msgspec.Meta(
            description="grip: target distance between the pads", extra_json_schema={"unit": "m"}
        ),
    ] = 0.0
    force: Annotated[
        float,
        msgspec.Meta(
            description="grip: maximum force of each finger", extra_json_schema={"unit": "N"}
        ),
    ] = 0.0
    spiral: Annotated[
        Spiral | None,
        msgspec.Meta(description="spiral: path to `position` and `orientation`"),
    ] = None


GoalState = Literal["accepted", "running", "succeeded", "failed", "cancelled"]


class GoalStatus(Message, frozen=True):
    """Status of a goal, published when it changes."""

    id: Annotated[int, msgspec.Meta(ge=0, description="id of the goal")]
    state: Annotated[GoalState, msgspec.Meta(description="state of the goal")]
    cause: Annotated[
        str,
        msgspec.Meta(
            description="one word for programs: why it failed or is at risk; empty: no problem"
        ),
    ] = ""
    text: Annotated[str, msgspec.Meta(description="one sentence for the user, with numbers")] = ""


def _scalar(text: str, unit: str) -> Any:
    """Return the metadata of a single quantity."""
    return msgspec.Meta(description=text, extra_json_schema={"unit": unit})


class BaseState(Message, frozen=True):
    """Pose and velocity of a mobile base by wheel odometry.

    The odometry frame is the base frame at the start: x points ahead, y to the left.
    """

    x: Annotated[float, _scalar("position in the odometry frame", "m")]
    y: Annotated[float, _scalar("position in the odometry frame", "m")]
    yaw: Annotated[
        float, _scalar("heading in the odometry frame, counter-clockwise, not wrapped", "rad")
    ]
    vx: Annotated[float, _scalar("forward velocity, in the base frame", "m/s")]
    wz: Annotated[float, _scalar("angular velocity, counter-clockwise", "rad/s")]


class BaseCommand(Message, frozen=True):
    """Velocity command of a mobile base, valid from this step on; without any field: stop."""

    vx: Annotated[float, _scalar("forward velocity, in the base frame", "m/s")] = 0.0
    wz: Annotated[float, _scalar("angular velocity, counter-clockwise", "rad/s")] = 0.0
    wheels: Annotated[
        tuple[float, float] | None,
        msgspec.Meta(
            description="velocities of the left and right wheel, instead of vx and wz",
            extra_json_schema={"unit": "rad/s", "shape": ["2"]},
        ),
    ] = None


class GripperState(Message, frozen=True):
    """State of a gripper with two fingers."""

    width: Annotated[float, _scalar("distance between the pads", "m")]
    force: Annotated[float, _scalar("contact force of the weaker finger", "N")]
    holding: Annotated[
        bool,
        msgspec.Meta(description="whether both fingers press on the same object from two sides"),
    ]


class GripperCommand(Message, frozen=True):
    """Width command of a gripper, valid from this step on."""

    width: Annotated[float, _scalar("target distance between the pads", "m")]
    force: Annotated[float, _scalar("maximum force of each finger, ≥ 0", "N")]


class Contacts(Message, frozen=True):
    """Pairs of links in contact, in the order of their names."""

    pairs: Annotated[
        list[tuple[str, str]],
        msgspec.Meta(description="names of two links", extra_json_schema={"shape": ["k", "2"]}),
    ]
    force: Annotated[
        list[float],
        msgspec.Meta(
            description="normal force of each pair, summed over its contact points",
            extra_json_schema={"unit": "N", "shape": ["k"]},
        ),
    ]
    distance: Annotated[
        list[float],
        msgspec.Meta(
            description="smallest distance of each pair; negative: penetration depth",
            extra_json_schema={"unit": "m", "shape": ["k"]},
        ),
    ]
    position: Annotated[
        list[Point],
        msgspec.Meta(
            description="point of that distance on the second link, in the world frame: x, y, z",
            extra_json_schema={"unit": "m", "shape": ["k", "3"]},
        ),
    ]


class Poses(Message, frozen=True):
    """True poses of named links in the world frame."""

    position: Annotated[
        list[Point],
        msgspec.Meta(
            description="position of each link: x, y, z",
            extra_json_schema={"unit": "m", "shape": ["n", "3"]},
        ),
    ]
    orientation: Annotated[
        list[Quaternion],
        msgspec.Meta(
            description="orientation of each link: quaternion x, y, z, w",
            extra_json_schema={"unit": "-", "shape": ["n", "4"]},
        ),
    ]


class Image(Message, frozen=True):
    """A camera image; in the optical frame, z points ahead, x to the right, y down."""

    width: Annotated[int, msgspec.Meta(ge=0, description="pixels in a row")]
    height: Annotated[int, msgspec.Meta(ge=0, description="rows")]
    encoding: Annotated[
        Literal["rgb8", "32FC1"],
        msgspec.Meta(
            description="of a pixel: bytes red, green, blue; or depth along z, float32 LE [m]"
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
            description="principal point: x, y",
            extra_json_schema={"unit": "pixel", "shape": ["2"]},
        ),
    ]


class Detections(Message, frozen=True):
    """Items detected in a camera image, one entry per item."""

    frame: Annotated[str, msgspec.Meta(description="reference link of the poses")]
    types: Annotated[
        list[str],
        msgspec.Meta(description="type of each item", extra_json_schema={"shape": ["k"]}),
    ]
    position: Annotated[
        list[Point],
        msgspec.Meta(
            description="centre of each item: x, y, z",
            extra_json_schema={"unit": "m", "shape": ["k", "3"]},
        ),
    ]
    orientation: Annotated[
        list[Quaternion],
        msgspec.Meta(
            description="orientation of each item: quaternion x, y, z, w; angles not seen are 0",
            extra_json_schema={"unit": "-", "shape": ["k", "4"]},
        ),
    ]
    confidence: Annotated[
        list[float],
        msgspec.Meta(
            description="share of the expected surface that was seen, 0 to 1",
            extra_json_schema={"unit": "-", "shape": ["k"]},
        ),
    ]


class PlanRequest(Message, frozen=True):
    """Request for a collision-free joint path."""

    id: Annotated[
        int, msgspec.Meta(ge=0, description="id of the request; a new id is a new request")
    ]
    start: Annotated[list[float], _vector("initial joint positions", "rad")]
    goal: Annotated[list[float], _vector("target joint positions, at rest", "rad")]
    held: Annotated[
        str, msgspec.Meta(description="link of the world held by the gripper; empty: none")
    ] = ""
    touches: Annotated[
        list[str], msgspec.Meta(description="links of the world that the robot may touch")
    ] = msgspec.field(default_factory=list)
    path: Annotated[
        list[list[float]],
        msgspec.Meta(
            description="joint positions from the goal on, along a path that is only checked; "
            "empty: none",
            extra_json_schema={"unit": "rad", "shape": ["k", "n"]},
        ),
    ] = msgspec.field(default_factory=list)
    load: Annotated[float, _scalar("mass of what the gripper holds, ≥ 0", "kg")] = 0.0


class Plan(Message, frozen=True):
    """A planner's answer: a timed trajectory from rest to rest, or why there is none."""

    id: Annotated[int, msgspec.Meta(ge=0, description="id of the request")]
    cause: Annotated[
        str,
        msgspec.Meta(
            description="one word for programs: why there is no plan; empty: there is one"
        ),
    ] = ""
    text: Annotated[str, msgspec.Meta(description="one sentence for the user, with numbers")] = ""
    times: Annotated[
        list[float],
        msgspec.Meta(
            description="time of each point since the start, from 0, increasing",
            extra_json_schema={"unit": "s", "shape": ["k"]},
        ),
    ] = msgspec.field(default_factory=list)
    position: Annotated[
        list[list[float]],
        msgspec.Meta(
            description="joint positions at each time",
            extra_json_schema={"unit": "rad", "shape": ["k", "n"]},
        ),
    ] = msgspec.field(default_factory=list)
    velocity: Annotated[
        list[list[float]],
        msgspec.Meta(
            description="joint velocities at each time",
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
