"""The parameters of the planner."""

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
    """SRDF with the pairs of links not to check. Default: neighbours, and pairs that touch in
    `posture` with the joints at 0."""
    prefix: str = ""
    """Prefix of this robot's names in the plant, such as `left/` if two bodies from one URDF
    share a world. All other parameters name joints and links without it."""
    frame: Text = "chassis"
    """Root link of the model, which identifies the robot among the poses."""
    tip: Text = "grasp"
    """Link that a held object moves with."""
    margin: NonNegative = 0.01
    """Minimum distance of the robot to obstacles and to itself [m]."""
    base_radius: Positive = 0.385
    """Clearance of the base's origin on its route, which lets it turn anywhere [m]."""
    base_half_width: Positive = 0.36
    """Clearance to both sides of a straight segment [m]."""
    base_speed: Positive = 0.5
    """Speed of the base, to find the fastest route [m/s]."""
    base_acceleration: Positive = 0.4
    """[m/s²]"""
    base_turn_speed: Positive = 0.8
    """Speed of the base when turning on the spot [rad/s]."""
    base_turn_acceleration: Positive = 0.8
    """[rad/s²]"""
    base_turn_jerk: Positive = 4.0
    """[rad/s³]"""
    velocity_limit: PositivePerJoint = each(1.5)
    """Largest velocity of each joint, never above the URDF's [rad/s]."""
    acceleration_limit: PositivePerJoint = each(3.0)
    """Largest acceleration of each joint [rad/s²]."""
    jerk_limit: PositivePerJoint = each(40.0)
    """Largest jerk of each joint [rad/s³]."""
    max_checks: Count = 20_000
    """Maximum number of collision checks per search."""
    latency_ns: Duration = 200_000_000
    """Time from a request to its answer, rounded up to the planner's period."""
    check_latency_ns: Duration = 32_000_000
    """Time from a request to its answer if a path is only checked."""
