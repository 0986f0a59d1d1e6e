"""The parameters of a controller that commands torques."""

from collections.abc import Iterator
from typing import Literal

from stepbus_participant import (
    Count,
    ModelFile,
    Names,
    NonNegativePerJoint,
    Own,
    Plugin,
    Positive,
    PositivePerJoint,
    Settings,
    Vector3,
    each,
)
from stepbus_participant.parameters import Keys


class Params(Settings):
    """Parameters of `stepbus_controller`."""

    law: Literal["computed_torque", "pd", "pd_gravity", "pid"] | Plugin
    """Control law. Your own class needs `__init__(robot, params)` and `torque(q, v, reference,
    dt)`, which returns torques, shape (n,) [N·m]."""
    model: ModelFile | None = None
    """URDF, xacro or MJCF of the robot. `pd`, `pid` and your own law also work without a
    model; they then need `joints` and `effort_limit`."""
    joints: Names | None = None
    """Controlled joints, in the order of every vector. Default: all joints of the model."""
    prefix: str = ""
    """Prefix of this robot's joint names in the plant, such as `left/` if two bodies from one
    URDF share a world. All other parameters use the names in the URDF."""
    gravity: Vector3 = (0.0, 0.0, -9.81)
    """Gravity in the frame of the robot's base [m/s²]."""
    effort_limit: PositivePerJoint | None = None
    """Torque limits [N·m]. Default: those of the model."""
    velocity: Literal["measured", "finite_difference", "filtered"] = "measured"
    """Source of the joint velocities."""
    cutoff_hz: Positive | None = None
    """Cutoff frequency of the velocity filter [Hz]; with `velocity: filtered`, and only then."""
    smoothing: Literal["none", "low_pass", "moving_average"] = "none"
    """Filter of the measurements. The status reports its delay."""
    time_constant: Positive | None = None
    """Time constant τ of the low-pass filter [s]; with `smoothing: low_pass`, and only then."""
    window: Count | None = None
    """Number of samples of the moving average; with `smoothing: moving_average`, and only then."""
    own: Own = {}

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield parameters that are missing without a model, or contradict each other."""
        if (self.velocity == "filtered") != (self.cutoff_hz is not None):
            yield ("cutoff_hz",), "is needed with velocity filtered, and only then"
        if (self.smoothing == "low_pass") != (self.time_constant is not None):
            yield ("time_constant",), "is needed with smoothing low_pass, and only then"
        if (self.smoothing == "moving_average") != (self.window is not None):
            yield ("window",), "is needed with smoothing moving_average, and only then"
        if self.model is not None:
            return
        if self.joints is None:
            yield (
                ("model",),
                "is missing; set it to a URDF, or set 'joints' for a law without a model",
            )
        elif self.law in ("computed_torque", "pd_gravity"):
            yield ("model",), "is missing; this law needs the robot's URDF"
        elif self.effort_limit is None:
            yield ("effort_limit",), "is missing; without a model it must be set"


class GainParams(Params):
    """Parameters of `stepbus_controller` with a law of this package."""

    kp: NonNegativePerJoint
    """Proportional gain [N·m/rad]; for computed_torque [1/s²]."""
    kd: NonNegativePerJoint
    """Derivative gain [N·m·s/rad]; for computed_torque [1/s]."""


class PIDParams(GainParams):
    """Parameters of `stepbus_controller` with the law `pid`."""

    ki: NonNegativePerJoint
    """Integral gain [N·m/(rad·s)]."""
    feed_forward: NonNegativePerJoint = each(0.0)
    """Torque per acceleration of the reference [N·m·s²/rad]: the inertia that the joint moves."""
    anti_windup: Literal["conditional_integration", "none"] = "conditional_integration"
    """Anti-windup, while a torque is at its limit. conditional_integration: the integral is
    frozen (Åström and Hägglund, PID Controllers, 2nd ed. 1995, section 3.5)."""


_PD = dict.fromkeys(("computed_torque", "pd", "pd_gravity"), GainParams)
Params.kinds = ("law", {**_PD, "pid": PIDParams})
