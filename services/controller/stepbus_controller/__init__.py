"""The parameters of a controller that commands torques."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

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
    imported_later,
    when,
)
from stepbus_participant.parameters import Keys

Gain = Annotated[NonNegativePerJoint, when(law=("computed_torque", "pd", "pd_gravity", "pid"))]


class Params(SmoothingParams):
    """Parameters of `stepbus_controller`."""

    law: Literal["computed_torque", "pd", "pd_gravity", "pid"] | Plugin
    """Control law; your own class has `__init__(robot, params)` and `torque(q, v, reference, dt)`
    that returns torques, shape (n,) [N·m]."""
    model: ModelFile | None = None
    """URDF, xacro, SDF or MJCF of the robot; a law that needs no model can use `joints` instead."""
    joints: Names | None = None
    """Joints under control, in the order of every vector. Default: all of the model."""
    prefix: str = ""
    """Prefix that the plant adds to the joint names of this robot: `left/` where two bodies of one
    URDF share a world. All other parameters name joints as the URDF does."""
    gravity: Vector3 = (0.0, 0.0, -9.81)
    """Gravity in the frame of the robot's base [m/s²]."""
    effort_limit: PositivePerJoint | None = None
    """Torque limits [N·m]. Default: those of the model."""
    kp: Gain
    """Proportional gain [N·m/rad], of computed_torque [1/s²]."""
    kd: Gain
    """Derivative gain [N·m·s/rad], of computed_torque [1/s]."""
    ki: Annotated[NonNegativePerJoint, when(law="pid")]
    """Integral gain [N·m/(rad·s)]."""
    feed_forward: Annotated[NonNegativePerJoint, when(law="pid")] = each(0.0)
    """Torque per acceleration of the reference [N·m·s²/rad]: the inertia that the joint moves."""
    anti_windup: Annotated[Literal["conditional_integration", "none"], when(law="pid")] = (
        "conditional_integration"
    )
    """Behaviour of the integral while a torque is at its limit; conditional_integration: the
    integral is frozen (Åström and Hägglund, PID Controllers, 2nd ed. 1995, section 3.5)."""
    velocity: Literal["measured", "finite_difference", "filtered"] = "measured"
    """Source of the joint velocities."""
    cutoff_hz: Annotated[Positive, when(velocity="filtered")]
    """Corner frequency of the filter [Hz]."""
    own: Own = {}

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is missing without a model."""
        yield from super().problems()
        if self.model is not None:
            return
        if self.joints is None:
            yield (("model",), "is missing; give a URDF, or 'joints' for a law that needs no model")
        elif self.law in ("computed_torque", "pd_gravity"):
            yield ("model",), "is missing; this law needs the robot's URDF"
        elif self.effort_limit is None:
            yield ("effort_limit",), "is missing; without a model it must be set"


if TYPE_CHECKING:
    from stepbus_controller.controller import Controller

__all__ = ["Controller", "Params"]

__getattr__ = imported_later(__name__, {"Controller": "controller"})
