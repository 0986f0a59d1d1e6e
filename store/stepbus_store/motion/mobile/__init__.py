"""The parameters of a controller that carries out goals of a mobile manipulator."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from stepbus_participant import (
    File,
    Finite,
    Names,
    NonNegative,
    Positive,
    PositivePerJoint,
    Text,
    Whole,
    each,
    imported_later,
)
from stepbus_participant.parameters import Keys
from stepbus_store.motion.joint_params import JointParams


class Params(JointParams):
    """Parameters of `stepbus_store.motion.mobile`; the root of `model` is on the floor."""

    prefix: str = ""
    """What the plant puts before this robot's names: `left/` where two bodies of one URDF share
    a world. All other parameters name joints and links without it."""
    acceleration_limit: PositivePerJoint = each(2.0)
    """Largest accelerations of the joints [rad/s²]."""
    jerk_limit: PositivePerJoint = each(20.0)
    """Largest jerks of the joints [rad/s³]."""
    srdf: File | None = None
    """Names the pairs of links that never or always touch. With it, lines, spirals, motions without
    a planner and stops in which any other links touch are refused or changed. Default: only a
    planner checks."""
    posture: dict[str, Finite] = {}
    """Positions of the model's other joints, by name [rad or m]. Default: 0."""
    collision_margin: NonNegative = 0.002
    """How close two links of the robot may come [m]."""
    tip: Text = "grasp"
    """Frame of the gripper, for the stow condition and for backing off."""
    tip_velocity: Positive = 0.25
    """Of straight lines and spirals [m/s]."""
    tip_acceleration: Positive = 0.5
    """[m/s²]"""
    tip_jerk: Positive = 5.0
    """[m/s³]"""
    tip_turning: Positive = 1.0
    """Fastest turn of the tip [rad/s]."""
    plan_timeout: Positive = 5.0
    """For the planner's answer, in simulation time [s]."""
    base_speed: Positive = 0.5
    """Of the base along its path [m/s]."""
    base_acceleration: Positive = 0.4
    """[m/s²]"""
    base_jerk: Positive = 2.0
    """[m/s³]"""
    base_turn_speed: Positive = 0.8
    """Of the base on the spot [rad/s]."""
    base_turn_acceleration: Positive = 0.8
    """[rad/s²]"""
    base_turn_jerk: Positive = 4.0
    """[rad/s³]"""
    base_brake: Positive = 4.0
    """Hardest braking of the base without slip [m/s²]; its speed near things follows from that."""
    base_turn_brake: Positive = 10.0
    """The same in a turn [rad/s²]."""
    base_clearance: Positive = 0.008
    """The base comes to rest before it is closer to what it must not touch [m]."""
    base_halt: NonNegative = 0.005
    """The base halts where something comes closer than that; more than the contacts are wrong by
    [m]."""
    base_step: NonNegative = 0.0
    """After so much of a planned route the base stops, and asks for the rest anew; 0, or with
    `go_together`: it drives it in one go [m]."""
    base_position: Positive = 1e-3
    """Largest error of the base at its goal [m]."""
    base_angle: Positive = 0.0017453292519943296
    """The same of its heading, 0.1° [rad]."""
    base_timeout: Positive = 3.0
    """For that, from the end of the motion on [s]."""
    base_lag: Positive = 0.05
    """Further behind its reference, the base is jammed [m]."""
    base_lag_angle: Positive = 0.10471975511965978
    """The same of its heading, 6° [rad]."""
    track: Positive = 0.5
    """Distance of the wheels, to name the one that is jammed [m]."""
    safe_height: Positive = 1.0
    """Largest height of `tip` above the floor while the base moves [m]."""
    safe_reach: Positive = 0.9
    """Largest distance of `tip` from the base's origin while the base moves [m]."""
    gripper_widest: Positive = 0.1
    """Largest width between the pads [m]."""
    gripper_tolerance: Positive = 1e-3
    """Of the width [m]."""
    gripper_force: NonNegative = 15.0
    """Holds the fingers before the first goal [N]."""
    first_force: Positive = 6.0
    """With which the fingers close on something; the force of the goal is the largest [N]."""
    slip: Positive = 1e-4
    """What is held is gripped harder whenever it has slid this far along the pads [m]."""
    pad_friction: Positive = 0.4
    """Assumed between a pad and what it holds, for the force that its weight needs [-]."""
    robot_links: Names | None = None
    """Links whose contacts are monitored. Default: all of the model."""
    pads: Names = ("left_pad", "right_pad")
    """The two links of the gripper that touch what it holds."""
    ignore: Names | None = None
    """Links that may touch the ground. Default: those with `wheel` or `caster` in their names."""
    collision_force: Positive = 0.5
    """Above it a forbidden touch is a collision [N]."""
    grip_force: Positive = 30.0
    """Above it the touch of a pad that grips is one as well; of one that does not, above 5 N
    [N]."""
    contact_range: Positive = 0.08
    """How far contacts report things; neither base nor arm is ever faster than it could stop within
    that [m]."""
    slow_within: Positive = 0.08
    """Closer than this to what it must not touch, the arm slows down [m]."""
    arm_brake: Positive = 1.0
    """Braking of each link near things; their largest speed there follows from that [m/s²]."""
    arm_lag: Positive = 0.02
    """Further behind its command, a joint of the arm is jammed [rad]."""
    arm_creep: Positive = 0.02
    """Slowest speed of a link near things [m/s]."""
    back_off: NonNegative = 0.05
    """How far the robot goes back from what it has touched [m]."""
    stop_within: NonNegative = 0.004
    """On a planner's path, the arm stops where something is closer [m]."""
    replans: Whole = 3
    """How often a goal may get another path."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong with the gripper."""
        if len(self.pads) != 2:
            yield ("pads",), f"names {len(self.pads)} links; a gripper has two"


if TYPE_CHECKING:
    from stepbus_store.motion.mobile.mobile_controller import MobileController

__all__ = ["MobileController", "Params"]

__getattr__ = imported_later(__name__, {"MobileController": "mobile_controller"})
