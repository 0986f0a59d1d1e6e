"""Joints that follow a path of the tip on one branch of the inverse kinematics."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import RobotModel, Vector
from stepbus_store.motion.goals.outcome import Refused

from .joint_path import JointPath
from .tip_path import TipPose

_CLOSE = 1e-5
"""Error at which one more step of Newton's method is the last: it squares the error [m, rad]."""

_LARGEST_STEP = 0.3
"""Of a joint between two poses [rad]; more is a jump to another branch."""


class Lost(Refused):
    """A path of the tip that the joints cannot follow; index: of the first such pose."""

    def __init__(self, cause: str, text: str, index: int) -> None:
        super().__init__(cause, text)
        self.index = index


def follow(
    robot: RobotModel, tip: str, path: Sequence[TipPose], start: Vector, singular_below: float
) -> JointPath:
    """Return the joints along a path of the tip, staying on the branch of their start.

    start: where the tip is at the first pose, shape (n,) [rad]. Between two poses the joints are
    predicted by the Jacobian, then corrected by Newton's method. Raises Lost with cause
    unreachable, limits or singular where the path leaves the branch.
    """
    tracer = _Tracer(robot, tip, singular_below)
    q, slope = start, np.zeros(len(start))
    rows: list[Vector] = []
    slopes: list[Vector] = []
    for index, pose in enumerate(path):
        ahead = pose.u - path[index - 1].u if index else 0.0
        try:
            q, slope = tracer.step(q, q + slope * ahead, pose)
        except Refused as exc:
            total = path[-1].u
            text = f"{exc} after {pose.u:.3f} of {total:.3f} m of the path"
            raise Lost(exc.cause, text, index) from exc
        rows.append(q)
        slopes.append(slope)
    u = np.array([pose.u for pose in path])
    return JointPath(u=u, q=np.array(rows), slope=np.array(slopes))


class _Tracer:
    def __init__(self, robot: RobotModel, tip: str, singular_below: float) -> None:
        self._robot = robot
        self._chain = robot.chain(tip)
        self._number = robot.frame_id(tip)
        self._least = singular_below

    def step(self, before: Vector, guess: Vector, wanted: TipPose) -> tuple[Vector, Vector]:
        """Return joints at a pose and their slope, from those before and a guess."""
        error = np.zeros(6)
        for q, jacobian, error in self._approach(guess, wanted.pose):
            if np.abs(q - before).max() > _LARGEST_STEP:
                self._check_singular(jacobian)
                raise Refused("singular", "singular: the joints would jump to another branch")
            if np.abs(error).max() < _CLOSE:
                self._check_singular(jacobian)
                both = _solved(jacobian, np.stack([error, wanted.twist], axis=1))
                end, slope = q.copy(), np.zeros(len(q))
                end[self._chain] += both[:, 0]
                slope[self._chain] = both[:, 1]
                self._check_limits(end)
                return end, slope
        miss = float(np.linalg.norm(error[:3])) * 1e3
        raise Refused("unreachable", f"unreachable: the tip stays {miss:.1f} mm away")

    def _approach(self, guess: Vector, pose: Any) -> Iterator[tuple[Vector, Vector, Vector]]:
        q = guess.copy()
        for _ in range(10):
            now, matrix = self._robot.jacobian(q, self._number)
            turn = now.rotation @ pin.log3(now.rotation.T @ pose.rotation)
            error = np.concatenate([pose.translation - now.translation, turn])
            jacobian = matrix[:, self._chain]
            yield q, jacobian, error
            q = q.copy()
            q[self._chain] += _solved(jacobian, error)

    def _check_singular(self, jacobian: Vector) -> None:
        least = float(np.linalg.svd(jacobian, compute_uv=False).min())
        if least < self._least:
            text = f"the smallest singular value falls to {least:.4f}, below {self._least:.4f},"
            raise Refused("singular", f"singular: {text}")

    def _check_limits(self, q: Vector) -> None:
        robot = self._robot
        beyond = np.maximum(robot.lower - q, q - robot.upper)
        worst = int(np.argmax(beyond))
        if beyond[worst] > 1e-9:
            joint = robot.joints[worst]
            raise Refused(
                "limits",
                f"out of limits: {joint} would have to go to {q[worst]:.3f} {robot.unit(joint)}, "
                f"its limits are [{robot.lower[worst]:.3f}, {robot.upper[worst]:.3f}],",
            )


def _solved(jacobian: Vector, twist: Vector) -> Vector:
    """Return the joint velocities of twists, shape (6,) or (6, k); jacobian: shape (6, m)."""
    if jacobian.shape[1] == 6:
        try:
            return np.asarray(np.linalg.solve(jacobian, twist), dtype=np.float64)
        except np.linalg.LinAlgError:
            pass
    return np.asarray(np.linalg.lstsq(jacobian, twist, rcond=None)[0], dtype=np.float64)
