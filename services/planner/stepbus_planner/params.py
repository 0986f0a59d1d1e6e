"""The parameters of the planner."""

from __future__ import annotations

from stepbus_participant import (
    Count,
    Duration,
    File,
    Finite,
    Names,
    NonNegative,
    PositivePerJoint,
    Settings,
    Text,
    each,
)


class Params(Settings):
    """Parameters of `stepbus_planner`."""

    model: File
    """URDF or xacro of the robot."""
    joints: Names
    """Joints to plan for, in the order of the requests."""
    posture: dict[str, Finite] = {}
    """Other joint → where it stands, neutral otherwise [rad or m]."""
    srdf: File | None = None
    """Pairs of links that never or always touch. Default: neighbours, and those that touch in
    `posture`."""
    frame: Text = "chassis"
    """Link by which the robot is found among the poses; it has to be the root of the URDF."""
    tip: Text = "grasp"
    """Frame that held items move with."""
    margin: NonNegative = 0.01
    """How close the robot may come to anything [m]."""
    held_margin: NonNegative = 0.003
    """How close held items may come to anything [m]."""
    velocity_limit: PositivePerJoint = each(1.5)
    """Largest velocity of each joint [rad/s]."""
    acceleration_limit: PositivePerJoint = each(3.0)
    """Largest acceleration of each joint [rad/s²]."""
    max_checks: Count = 20_000
    """Positions that a search checks at most."""
    latency_ns: Duration = 200_000_000
    """From a request to its answer; rounded up to a multiple of the planner's period."""
