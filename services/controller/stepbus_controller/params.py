"""The parameters of a controller that commands torques."""

from collections.abc import Iterator
from typing import Annotated, Literal

from stepbus_kinematics import SmoothingParams
from stepbus_participant import (
    ModelFile,
    Names,
    NonNegativePerJoint,
    Own,
    Plugin,
    Positive,
    PositivePerJoint,
    Vector3,
    each,
    when,
)
from stepbus_participant.parameters import Keys

Gain = Annotated[NonNegativePerJoint, when(law=("computed_torque", "pd", "pd_gravity", "pid"))]


class Params(SmoothingParams):
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
    kp: Gain
    """Proportional gain [N·m/rad]; for computed_torque [1/s²]."""
    kd: Gain
    """Derivative gain [N·m·s/rad]; for computed_torque [1/s]."""
    ki: Annotated[NonNegativePerJoint, when(law="pid")]
    """Integral gain [N·m/(rad·s)]."""
    feed_forward: Annotated[NonNegativePerJoint, when(law="pid")] = each(0.0)
    """Torque per acceleration of the reference [N·m·s²/rad]: the inertia that the joint moves."""
    anti_windup: Annotated[Literal["conditional_integration", "none"], when(law="pid")] = (
        "conditional_integration"
    )
    """Anti-windup, while a torque is at its limit. conditional_integration: the integral is
    frozen (Åström and Hägglund, PID Controllers, 2nd ed. 1995, section 3.5)."""
    velocity: Literal["measured", "finite_difference", "filtered"] = "measured"
    """Source of the joint velocities."""
    cutoff_hz: Annotated[Positive, when(velocity="filtered")]
    """Cutoff frequency of the velocity filter [Hz]."""
    own: Own = {}

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is missing without a model."""
        yield from super().problems()
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
