"""Where the frames of a robot are, for joints in an order of our choice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from stepbus_participant.settings import nearest
from stepbus_schemas import RunError, WiringError

from .dynamics import Dynamics, Vector, read_urdf, reduced

Places = NDArray[np.intp]
"""Where some of the joints stand among all, increasing."""


@dataclass(frozen=True, kw_only=True)
class Overload:
    """A joint that needs more torque than its motor has [N·m]."""

    joint: str
    required: float
    available: float

    def __str__(self) -> str:
        return f"{self.joint} needs {self.required:.1f} N·m and has {self.available:.1f} N·m"


class Kinematics:
    """Forward kinematics, Jacobians and torques of a fixed-base robot.

    path: URDF. joints: those that move, in the order of every vector of shape (n,); all others
    stand at neutral. Only joints with limits, so that a random pose means something.
    effort_limit: shape (n,) [N·m]; None: the URDF's.
    Raises WiringError for what is wrong with the URDF or the joints.
    """

    def __init__(
        self, path: Path, joints: Sequence[str], effort_limit: Sequence[float] | None = None
    ) -> None:
        self.path = path
        self.joints = tuple(joints)
        self.model: Any = reduced(read_urdf(path), joints, path)
        self.data: Any = self.model.createData()
        ids = [self.model.getJointId(name) for name in joints]
        self._in_model = np.array([self.model.idx_qs[i] for i in ids], dtype=np.intp)
        lower, upper = self.model.lowerPositionLimit, self.model.upperPositionLimit
        self.lower: Vector = np.array(lower)[self._in_model]
        self.upper: Vector = np.array(upper)[self._in_model]
        self.velocity_limit: Vector = np.array(self.model.upperVelocityLimit)[
            [self.model.idx_vs[i] for i in ids]
        ]
        self._check_limits()
        self.dynamics = Dynamics(path, joints)
        limit = self.dynamics.effort_limit if effort_limit is None else effort_limit
        self.effort_limit: Vector = np.array(limit, dtype=np.float64)

    def _check_limits(self) -> None:
        rows = zip(self.joints, self.lower, self.upper, strict=True)
        free = [name for name, low, high in rows if not -np.inf < low < high < np.inf]
        if free or self.model.nq != len(self.joints):
            raise WiringError(
                f"{self.path}: joints {', '.join(free or self.joints)} have no position limits; "
                "inverse kinematics needs them"
            )

    def in_model(self, q: Vector) -> Vector:
        """Return positions, shape (n,) [rad], in the order of Pinocchio's model."""
        out = np.empty(len(q))
        out[self._in_model] = q
        return out

    def frame_id(self, name: str) -> int:
        """Return Pinocchio's number of a frame.

        Raises RunError for one that the model lacks.
        """
        if not self.model.existFrame(name):
            known = [frame.name for frame in self.model.frames]
            raise RunError(f"frame {name!r} is not in {self.path.name}; {nearest(name, known)}")
        number: int = self.model.getFrameId(name)
        return number

    def place(self, q: Vector, frame: str) -> Any:
        """Return the pose of a frame in the robot's base, as a `pinocchio.SE3`.

        q: shape (n,) [rad]. An empty name is the base itself.
        """
        if not frame:
            return pin.SE3.Identity()
        number = self.frame_id(frame)
        pin.framesForwardKinematics(self.model, self.data, self.in_model(q))
        return self.data.oMf[number].copy()

    def chain(self, tip: str) -> Places:
        """Return which of the joints move a frame: their places, increasing."""
        frame = self.model.frames[self.frame_id(tip)]
        above = {self.model.names[i] for i in self.model.supports[frame.parentJoint]}
        return np.array([i for i, name in enumerate(self.joints) if name in above], dtype=np.intp)

    def jacobian(self, q: Vector, number: int) -> tuple[Any, Vector]:
        """Return pose and Jacobian of a frame, shape (6, n), in the axes of the base [m/rad, -]."""
        # computeFrameJacobian would do both in one, but it leaves the placements as they were.
        pin.computeJointJacobians(self.model, self.data, self.in_model(q))
        pin.updateFramePlacement(self.model, self.data, number)
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        matrix = pin.getFrameJacobian(self.model, self.data, number, axes)
        return self.data.oMf[number], matrix[:, self._in_model]

    def cannot_hold(self, q: Vector, among: Places | None = None) -> Overload | None:
        """Return the joint whose motor is furthest from holding the robot at rest at q.

        among: places of the joints that are looked at; None: all. None: all can hold.
        """
        places = np.arange(len(self.joints)) if among is None else among
        required = np.abs(self.dynamics.gravity(q))[places]
        available = self.effort_limit[places]
        worst = int(np.argmax(required - available))
        if required[worst] <= available[worst]:
            return None
        return Overload(
            joint=self.joints[places[worst]],
            required=float(required[worst]),
            available=float(available[worst]),
        )
