"""The parameters of the planner."""

from typing import TYPE_CHECKING

from stepbus_participant import (
    Count,
    Duration,
    File,
    Finite,
    ModelFile,
    Names,
    NonNegative,
    Positive,
    PositivePerJoint,
    Settings,
    Text,
    each,
    imported_later,
)


class Params(Settings):
    """Parameters of `stepbus_store.planner`."""

    model: ModelFile
    """URDF or xacro; planning is relative to its root."""
    joints: Names
    """Joints to plan for; each has position limits."""
    posture: dict[str, Finite] = {}
    """Positions of the other joints, by name [rad or m]."""
    srdf: File | None = None
    """Pairs of links not to check. Default: neighbours, and pairs that touch in `posture` with the
    joints at 0."""
    prefix: str = ""
    """What the plant puts before this robot's names: `left/` where two bodies of one URDF share
    a world. All other parameters name joints and links without it."""
    frame: Text = "chassis"
    """Link that identifies the robot among the poses; the root of the model."""
    tip: Text = "grasp"
    """Link that a held object moves with."""
    margin: NonNegative = 0.01
    """Minimum distance of the robot to obstacles and to itself [m]."""
    held_margin: NonNegative = 0.003
    """Minimum distance of a held object to everything else [m]."""
    path_margin: NonNegative = 0.003
    """Minimum distance of the robot on a path that is only checked, such as a straight line [m]."""
    base_radius: Positive = 0.385
    """Distance of the base's origin to everything on its route: it can turn anywhere [m]."""
    base_half_width: Positive = 0.36
    """The same to both sides of a straight segment [m]."""
    base_speed: Positive = 0.5
    """How fast the base drives, to find its quickest route [m/s]."""
    base_acceleration: Positive = 0.4
    """[m/s²]"""
    base_turn_speed: Positive = 0.8
    """The same on the spot [rad/s]."""
    base_turn_acceleration: Positive = 0.8
    """[rad/s²]"""
    velocity_limit: PositivePerJoint = each(1.5)
    """Largest velocity of each joint, never above the URDF's [rad/s]."""
    acceleration_limit: PositivePerJoint = each(3.0)
    """Largest acceleration of each joint [rad/s²]."""
    jerk_limit: PositivePerJoint = each(40.0)
    """Largest jerk of each joint [rad/s³]."""
    max_checks: Count = 20_000
    """Limit on collision checks of a search."""
    latency_ns: Duration = 200_000_000
    """From a request to its answer, rounded up to the planner's period."""
    check_latency_ns: Duration = 32_000_000
    """The same, where a path is only checked."""


if TYPE_CHECKING:
    from stepbus_store.planner.planner import Planner

__all__ = ["Params", "Planner"]

__getattr__ = imported_later(__name__, {"Planner": "planner"})
