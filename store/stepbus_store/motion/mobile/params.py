"""The parameters of a controller that carries out goals of a mobile manipulator."""

from collections.abc import Iterator

from stepbus_participant import (
    File,
    Finite,
    Names,
    NonNegative,
    Positive,
    PositivePerJoint,
    Text,
    each,
)
from stepbus_participant.parameters import Keys
from stepbus_store.motion.joint_params import JointParams


class Params(JointParams):
    """Parameters of `stepbus_store.motion.mobile`; the root of `model` is on the floor."""

    prefix: str = ""
    """Prefix of this robot's names in the plant, such as `left/` if two bodies from one URDF
    share a world. All other parameters name joints and links without it."""
    acceleration_limit: PositivePerJoint = each(2.0)
    """Acceleration limits of the joints [rad/s²]."""
    jerk_limit: PositivePerJoint = each(20.0)
    """Jerk limits of the joints [rad/s³]."""
    srdf: File | None = None
    """Lists the pairs of links that never or always touch. With it, the controller refuses or
    changes lines, spirals, motions without a planner and stops with any other collision.
    Default: only a planner checks."""
    posture: dict[str, Finite] = {}
    """Positions of the other joints of the model, by name [rad or m]. Default: 0."""
    collision_margin: NonNegative = 0.002
    """Smallest distance between two links of the robot [m]."""
    tip: Text = "grasp"
    """Link of the gripper, for the stow condition and for backing off."""
    tip_velocity: Positive = 0.25
    """Speed of the tip on straight lines and spirals [m/s]."""
    tip_acceleration: Positive = 0.5
    """[m/s²]"""
    tip_jerk: Positive = 5.0
    """[m/s³]"""
    plan_timeout: Positive = 5.0
    """Timeout for the planner's answer, in simulation time [s]."""
    base_speed: Positive = 0.5
    """Speed of the base along its path [m/s]."""
    base_acceleration: Positive = 0.4
    """[m/s²]"""
    base_jerk: Positive = 2.0
    """[m/s³]"""
    base_turn_speed: Positive = 0.8
    """Speed of the base when turning on the spot [rad/s]."""
    base_turn_acceleration: Positive = 0.8
    """[rad/s²]"""
    base_turn_jerk: Positive = 4.0
    """[rad/s³]"""
    base_brake: Positive = 4.0
    """Hardest braking of the base without slip [m/s²]; it determines the speed near obstacles."""
    base_turn_brake: Positive = 10.0
    """Hardest braking in a turn on the spot [rad/s²]."""
    base_clearance: Positive = 0.008
    """Distance at which the base comes to rest in front of an obstacle [m]."""
    base_halt: NonNegative = 0.005
    """Distance of an obstacle at which the base halts; must exceed the error of the contacts
    [m]."""
    base_step: NonNegative = 0.0
    """Length of a planned route after which the base stops and replans the rest; 0, or with
    `go_together`: never [m]."""
    base_position: Positive = 1e-3
    """Largest error of the base at its goal [m]."""
    base_angle: Positive = 0.0017453292519943296
    """Largest error of its heading at its goal, 0.1° by default [rad]."""
    base_timeout: Positive = 3.0
    """For that, from the end of the motion on [s]."""
    base_lag: Positive = 0.05
    """Lag behind its reference from which the base counts as jammed [m]."""
    base_lag_angle: Positive = 0.10471975511965978
    """Lag of its heading from which it counts as jammed, 6° by default [rad]."""
    track: Positive = 0.5
    """Distance between the wheels, to identify a jammed wheel [m]."""
    safe_height: Positive = 1.0
    """Largest height of `tip` above the floor while the base moves [m]."""
    safe_reach: Positive = 0.9
    """Largest distance of `tip` from the base's origin while the base moves [m]."""
    gripper_widest: Positive = 0.1
    """Width of the open gripper [m]."""
    gripper_tolerance: Positive = 1e-3
    """Tolerance of the width [m]."""
    gripper_force: NonNegative = 15.0
    """Force that holds the fingers before the first goal [N]."""
    first_force: Positive = 6.0
    """Force with which the fingers close; the force of the goal is the maximum [N]."""
    slip: Positive = 1e-4
    """Slip along the pads after which the gripper grips harder [m]."""
    pad_friction: Positive = 0.4
    """Assumed friction between a pad and a held object, to compute the force for its weight [-]."""
    pads: Names = ("left_pad", "right_pad")
    """The two links of the gripper that touch a held object."""
    ignore: Names | None = None
    """Links that may touch the ground. Default: those with `wheel` or `caster` in their names."""
    collision_force: Positive = 0.5
    """Force above which a forbidden contact is a collision [N]."""
    grip_force: Positive = 30.0
    """Force above which a contact of a gripping pad is a collision; 5 N for a pad that does not
    grip [N]."""
    contact_range: Positive = 0.08
    """Range of the contact sensors; base and arm always stay slow enough to stop within it [m]."""
    slow_within: Positive = 0.08
    """Distance from an obstacle below which the arm slows down [m]."""
    arm_brake: Positive = 1.0
    """Braking of each link near obstacles; it determines the speed there [m/s²]."""
    arm_lag: Positive = 0.02
    """Lag behind its command from which a joint of the arm counts as jammed [rad]."""
    arm_creep: Positive = 0.02
    """Lowest speed of a link near obstacles [m/s]."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong with the gripper."""
        if len(self.pads) != 2:
            yield ("pads",), f"names {len(self.pads)} links; a gripper has two"
