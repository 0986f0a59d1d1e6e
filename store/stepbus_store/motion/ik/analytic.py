"""Analytic inverse kinematics of six revolute joints."""

import math
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import RobotModel, Vector
from stepbus_participant import extra_hint

try:
    from eaik.IK_HP import HPRobot
except ModuleNotFoundError:  # The extra `robots` is not installed: `AnalyticChain.warning`.
    HPRobot = None

TURN = 2 * math.pi

_EXACT = 1e-6
"""Largest error of a branch, of any entry of the pose [m, -]; others are none."""

_SAME = 1e-6
"""Joint distance below which two branches are one [rad]."""


class AnalyticChain:
    """Analytic inverse kinematics of six revolute joints in a row, by eaik.

    Ostermeier, Külz, Althoff: Automatic Geometric Decomposition for Analytical Inverse Kinematics,
    IEEE RA-L, 2025. tip: frame fixed to the last of them. Raises RunError for an unknown frame.
    solves: whether the tip is moved by such joints and their geometry can be decomposed. warning:
    that eaik is missing where it might; empty otherwise.
    """

    def __init__(self, robot: RobotModel, tip: str) -> None:
        self._robot = robot
        self._chain = robot.chain(tip)
        self._tip = robot.frame_id(tip)
        self._solver: Any = None
        self.warning = ""
        if HPRobot is not None and self._is_six_revolute():
            self._set_up()
        elif self._is_six_revolute():
            self.warning = (
                f"tip {tip!r}: eaik is not installed, so one solution of a pose is searched, "
                f"instead of all computed{extra_hint('eaik')}"
            )

    @property
    def solves(self) -> bool:
        """Return whether there are analytic solutions."""
        return self._solver is not None

    def branches(self, target: Any, q: Vector) -> list[Vector]:
        """Return all solutions for a pose of the tip, each of shape (n,) in [-π, π] [rad].

        target: in the robot's base, a `pinocchio.SE3`. q: shape (n,) [rad]; joints that do not
        move the tip stay there. Forward kinematics verified each; limits are not checked.
        """
        last = (target * self._tip_in_last.inverse()).homogeneous
        # eaik counts the orientation from the one with all joints at 0.
        last[:3, :3] = last[:3, :3] @ self._turned_at_zero.T
        found: list[Vector] = []
        for row in self._solver.IK(last).Q:
            branch = q.copy()
            branch[self._order] = np.remainder(np.array(row) + math.pi, TURN) - math.pi
            is_new = all(np.abs(_wrapped(branch - other)).max() > _SAME for other in found)
            if is_new and self._reaches(branch, target):
                found.append(branch)
        return found

    def _is_six_revolute(self) -> bool:
        model = self._robot.model
        types = [model.joints[model.getJointId(name)].shortname() for name in self._names()]
        return len(types) == 6 and all(name.startswith("JointModelR") for name in types)

    def _names(self) -> list[str]:
        """Return the joints that move the tip, starting at the base."""
        model = self._robot.model
        names = [self._robot.joints[index] for index in self._chain]
        return sorted(names, key=model.getJointId)

    def _set_up(self) -> None:
        """Give eaik the axes and their positions, with all joints at 0, in the base's axes."""
        robot, model, data = self._robot, self._robot.model, self._robot.data
        ids = [model.getJointId(name) for name in self._names()]
        self._order = np.array([robot.joints.index(name) for name in self._names()], dtype=np.intp)
        zero = robot.in_model(np.zeros(len(robot.joints)))
        pin.computeJointJacobians(model, data, zero)
        pin.updateFramePlacements(model, data)
        axes = []
        for number in ids:
            matrix = pin.getJointJacobian(model, data, number, pin.ReferenceFrame.WORLD)
            axes.append(matrix[3:, model.idx_vs[number]])
        origins = np.array([data.oMi[number].translation for number in ids])
        offsets = np.diff(origins, axis=0, prepend=np.zeros((1, 3)))
        self._turned_at_zero = data.oMi[ids[-1]].rotation.copy()
        self._tip_in_last = data.oMi[ids[-1]].inverse() * data.oMf[self._tip]
        solver = HPRobot(np.array(axes), np.vstack([offsets, np.zeros(3)]))
        if solver.hasKnownDecomposition():
            self._solver = solver

    def _reaches(self, q: Vector, target: Any) -> bool:
        model, data = self._robot.model, self._robot.data
        pin.framesForwardKinematics(model, data, self._robot.in_model(q))
        error = data.oMf[self._tip].homogeneous - target.homogeneous
        return bool(np.abs(error).max() < _EXACT)


def _wrapped(angle: Vector) -> Vector:
    """Return angles in [-π, π] [rad]."""
    wrapped: Vector = np.remainder(angle + math.pi, TURN) - math.pi
    return wrapped
