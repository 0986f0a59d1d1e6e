"""What robots, their tasks and their world exchange."""

from typing import Annotated, ClassVar, Literal

import msgspec

from stepbus_schemas.messages.base import Message, Point, Quaternion, meta


class JointState(Message, frozen=True):
    """Joint states; a quantity that is not sensed is absent."""

    position: Annotated[list[float] | None, meta("measured positions", "rad", "n")] = None
    velocity: Annotated[list[float] | None, meta("measured velocities", "rad/s", "n")] = None
    effort: Annotated[list[float] | None, meta("torques applied by the motors", "N·m", "n")] = None
    target: Annotated[list[float] | None, meta("current position targets", "rad", "n")] = None


class SensedJoints(JointState, frozen=True):
    """A `JointState/1` with positions and velocities, for a program that needs both."""

    TYPE: ClassVar[str] = "JointState/1"

    position: Annotated[list[float], meta("measured positions", "rad", "n")]
    velocity: Annotated[list[float], meta("measured velocities", "rad/s", "n")]


JointMode = Literal["torque", "velocity", "position", "teleport", "brake"]
"""What the values of a JointCommand are."""


class JointCommand(Message, frozen=True):
    """Joint commands, valid from this step on."""

    mode: Annotated[JointMode, meta("meaning of `values`")]
    values: Annotated[
        list[float],
        meta(
            "torque, velocity, position, or position to teleport to; unused in mode brake",
            "N·m, rad/s, rad, rad, -",
            "n",
        ),
    ]
    velocity: Annotated[
        list[float] | None,
        meta("feed-forward in mode position; initial velocity in mode teleport", "rad/s", "n"),
    ] = None
    effort_limit: Annotated[
        list[float] | None, meta("maximum torque in modes velocity and position", "N·m", "n")
    ] = None


class JointReference(Message, frozen=True):
    """Reference trajectory of the joints, with exact derivatives."""

    position: Annotated[list[float], meta("desired positions", "rad", "n")]
    velocity: Annotated[list[float], meta("desired velocities", "rad/s", "n")]
    acceleration: Annotated[list[float], meta("desired accelerations", "rad/s²", "n")]


class ControllerStatus(Message, frozen=True):
    """Tracking status of a controller."""

    error: Annotated[list[float], meta("reference minus measured position", "rad", "n")]
    saturated: Annotated[
        list[bool], meta("whether the command is saturated at its limit", "-", "n")
    ]
    warnings: Annotated[list[str], meta("warnings of the controller")] = []


class Event(Message, frozen=True):
    """A message for the user, shown during the run."""

    level: Annotated[Literal["info", "warning", "error"], meta("severity")]
    text: Annotated[str, meta("the message")]


GoalType = Literal[
    "move_joints",
    "move_to_pose",
    "move_linear",
    "spiral",
    "drive",
    "turn",
    "go_to",
    "go_together",
    "grip",
    "back_to_rest",
    "stop",
]
"""What a goal asks for."""


class Spiral(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """A spiral path around a vertical axis, which may narrow and rise."""

    centre: Annotated[Point, meta("point of the axis at the starting height: x, y, z", "m")]
    radius: Annotated[tuple[float, float], meta("radius at the start and at the end", "m", "2")]
    turns: Annotated[float, meta("number of turns, counter-clockwise")]
    rise: Annotated[float, meta("total rise along the path", "m")] = 0.0


class Goal(Message, frozen=True):
    """A goal for a controller; it may take many steps."""

    id: Annotated[int, meta("id of the goal; a new id replaces the current goal", ge=0)]
    type: Annotated[
        GoalType,
        meta(
            "what to do; `go_together`: as go_to, but the base waits for the path of the arm's "
            "goal that follows; `back_to_rest`: bring the arm back to its rest pose from "
            "anywhere; `stop`: cancel the current goal and come to rest"
        ),
    ]
    joints: Annotated[list[str], meta("move_joints: names of the joints to move")] = []
    values: Annotated[
        list[float],
        meta("move_joints: target positions, in the order of `joints`", "rad", "joints"),
    ] = []
    tip: Annotated[
        str, meta("move_to_pose, move_linear, spiral: frame of the robot that moves to the pose")
    ] = ""
    position: Annotated[
        Point | None,
        meta("move_to_pose, move_linear, spiral: target position of the tip: x, y, z", "m"),
    ] = None
    orientation: Annotated[
        Quaternion | None,
        meta(
            "move_to_pose, move_linear, spiral: target orientation of the tip, quaternion x, y, "
            "z, w",
            "-",
        ),
    ] = None
    frame: Annotated[
        str, meta("reference frame of the pose: a link or `odometry`; empty: the robot's base")
    ] = ""
    duration: Annotated[
        float,
        meta("duration of the motion, if the limits allow it; 0: as fast as possible", "s"),
    ] = 0.0
    touches: Annotated[
        list[str], meta("links of the world that the robot may touch during the motion")
    ] = []
    by: Annotated[
        float, meta("drive: distance ahead; turn: angle, counter-clockwise", "m, rad")
    ] = 0.0
    base: Annotated[
        Point | None,
        meta(
            "go_to, go_together: target x, y, yaw of the base in the odometry frame; other goals: "
            "the base's target while arm or gripper move with it",
            "m, m, rad",
        ),
    ] = None
    width: Annotated[float, meta("grip: target distance between the pads", "m")] = 0.0
    force: Annotated[float, meta("grip: maximum force of each finger", "N")] = 0.0
    spiral: Annotated[Spiral | None, meta("spiral: path to `position` and `orientation`")] = None


GoalState = Literal["accepted", "running", "succeeded", "failed", "cancelled"]
"""State of a goal; the last three are final."""


class GoalStatus(Message, frozen=True):
    """Status of a goal, published when it changes."""

    id: Annotated[int, meta("id of the goal", ge=0)]
    state: Annotated[GoalState, meta("state of the goal")]
    cause: Annotated[
        str, meta("one word, for programs: why it failed or may fail; empty: no problem")
    ] = ""
    text: Annotated[str, meta("message for the user, with numbers")] = ""


class BaseState(Message, frozen=True):
    """Pose and velocity of a mobile base by wheel odometry.

    The odometry frame is the base frame at the start: x points ahead, y to the left.
    """

    x: Annotated[float, meta("position in the odometry frame", "m")]
    y: Annotated[float, meta("position in the odometry frame", "m")]
    yaw: Annotated[
        float, meta("heading in the odometry frame, counter-clockwise, not wrapped", "rad")
    ]
    vx: Annotated[float, meta("forward velocity, in the base frame", "m/s")]
    wz: Annotated[float, meta("angular velocity, counter-clockwise", "rad/s")]


class BaseCommand(Message, frozen=True):
    """Velocity command of a mobile base, valid from this step on; without any field: stop."""

    vx: Annotated[float, meta("forward velocity, in the base frame", "m/s")] = 0.0
    wz: Annotated[float, meta("angular velocity, counter-clockwise", "rad/s")] = 0.0
    wheels: Annotated[
        tuple[float, float] | None,
        meta("velocities of the left and right wheel, instead of vx and wz", "rad/s", "2"),
    ] = None


class GripperState(Message, frozen=True):
    """State of a gripper with two fingers."""

    width: Annotated[float, meta("distance between the pads", "m")]
    force: Annotated[float, meta("contact force of the weaker finger", "N")]
    holding: Annotated[bool, meta("whether both fingers press on the same object from two sides")]
    slip: Annotated[
        float, meta("how far that object has slid along the pads since it was gripped", "m")
    ] = 0.0


class GripperCommand(Message, frozen=True):
    """Width command of a gripper, valid from this step on."""

    width: Annotated[float, meta("target distance between the pads", "m")]
    force: Annotated[float, meta("maximum force of each finger, ≥ 0", "N")]


class CameraTrigger(Message, frozen=True):
    """Request for one image of a camera, taken at the plant's next step."""

    id: Annotated[int, meta("id of the request; a new id is a new request", ge=0)]
    frame: Annotated[str, meta("reference link of `position`")] = ""
    position: Annotated[Point | None, meta("where to look for an item: x, y, z", "m")] = None


class EmergencyStop(Message, frozen=True):
    """Emergency stop of a plant: whether it brakes all joints and bases and ignores commands."""

    active: Annotated[bool, meta("whether the plant brakes; false: it runs")]
    by: Annotated[str, meta("who stopped or released it; empty: never stopped")] = ""
    since: Annotated[float, meta("simulation time of the last stop or release", "s")] = 0.0

    def __str__(self) -> str:
        """Return who has stopped the plant, and when."""
        return f"emergency stop by {self.by} at {self.since:.2f} s"


class Contacts(Message, frozen=True):
    """Pairs of links in contact, in the order of their names."""

    pairs: Annotated[list[tuple[str, str]], meta("names of two links", "", "k 2")]
    force: Annotated[
        list[float], meta("normal force of each pair, summed over its contact points", "N", "k")
    ]
    distance: Annotated[
        list[float],
        meta(
            "smallest distance between the two links of each pair; negative: penetration depth",
            "m",
            "k",
        ),
    ]
    position: Annotated[
        list[Point],
        meta("closest point on the second link, in the world frame: x, y, z", "m", "k 3"),
    ]
    peak_force: Annotated[
        list[float],
        meta(
            "largest normal force of each pair since the previous message; empty: unknown", "N", "k"
        ),
    ] = []
    impulse: Annotated[
        list[float],
        meta("normal impulse of each pair since the previous message; empty: unknown", "N·s", "k"),
    ] = []

    @property
    def peaks(self) -> list[float]:
        """Return the peak forces [N]; where they are unknown, the forces at the end."""
        return self.peak_force or self.force


class Poses(Message, frozen=True):
    """True poses of named links in the world frame."""

    position: Annotated[list[Point], meta("position of each link: x, y, z", "m", "n 3")]
    orientation: Annotated[
        list[Quaternion], meta("orientation of each link: quaternion x, y, z, w", "-", "n 4")
    ]


class Image(Message, frozen=True):
    """A camera image; in the optical frame, z points ahead, x to the right, y down."""

    width: Annotated[int, meta("pixels per row", ge=0)]
    height: Annotated[int, meta("rows", ge=0)]
    encoding: Annotated[
        Literal["rgb8", "32FC1"],
        meta("format of a pixel: bytes red, green, blue; or depth along z, float32 LE [m]"),
    ]
    data: Annotated[bytes, meta("the pixels, row by row from the top left corner")]
    focal: Annotated[tuple[float, float], meta("focal length in x and y", "pixel", "2")]
    centre: Annotated[tuple[float, float], meta("principal point: x, y", "pixel", "2")]


class Detections(Message, frozen=True):
    """Items detected in a camera image, one entry per item."""

    frame: Annotated[str, meta("reference link of the poses")]
    types: Annotated[list[str], meta("type of each item", "", "k")]
    position: Annotated[list[Point], meta("centre of each item: x, y, z", "m", "k 3")]
    orientation: Annotated[
        list[Quaternion],
        meta(
            "orientation of each item: quaternion x, y, z, w; angles that cannot be seen are 0",
            "-",
            "k 4",
        ),
    ]
    confidence: Annotated[
        list[float], meta("visible fraction of the expected surface, 0 to 1", "-", "k")
    ]
    hidden: Annotated[float, meta("occluded fraction of the region searched, 0 to 1")] = 0.0


class PlanRequest(Message, frozen=True):
    """Request for a collision-free joint path."""

    id: Annotated[int, meta("id of the request; a new id is a new request", ge=0)]
    start: Annotated[list[float], meta("initial joint positions", "rad", "n")]
    goal: Annotated[list[float], meta("target joint positions, at rest", "rad", "n")]
    held: Annotated[str, meta("link of the world held by the gripper; empty: none")] = ""
    touches: Annotated[list[str], meta("links of the world that the robot may touch")] = []
    path: Annotated[
        list[list[float]],
        meta(
            "joint positions after the goal, along a path that is only checked; empty: none",
            "rad",
            "k n",
        ),
    ] = []
    load: Annotated[float, meta("payload of the gripper, ≥ 0", "kg")] = 0.0
    base: Annotated[
        tuple[Point, Point] | None,
        meta(
            "in place of joints: start and goal of the base, each x, y, yaw in the odometry frame",
            "m, m, rad",
        ),
    ] = None
    bases: Annotated[
        list[Point],
        meta(
            "poses of the base for which the path must be collision-free; it is planned at the "
            "last one; x, y, yaw in the frame of the latest `base`; empty: the current pose",
            "m, m, rad",
            "k 3",
        ),
    ] = []


class Plan(Message, frozen=True):
    """A planner's answer: a timed trajectory from rest to rest, or why there is none."""

    id: Annotated[int, meta("id of the request", ge=0)]
    cause: Annotated[
        str, meta("one word, for programs: why there is no plan; empty: there is one")
    ] = ""
    text: Annotated[str, meta("message for the user, with numbers")] = ""
    times: Annotated[list[float], meta("time of each point, increasing from 0", "s", "k")] = []
    position: Annotated[list[list[float]], meta("joint positions at each time", "rad", "k n")] = []
    velocity: Annotated[
        list[list[float]], meta("joint velocities at each time", "rad/s", "k n")
    ] = []
    route: Annotated[
        list[Point],
        meta(
            "path of a base: x, y, yaw at the end of each arc, turn or line, as `base` of the "
            "request",
            "m, m, rad",
            "k 3",
        ),
    ] = []
