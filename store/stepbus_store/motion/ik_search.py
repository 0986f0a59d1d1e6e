"""Inverse kinematics: damped least squares with restarts, and what is wrong with a pose."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
import pinocchio as pin

from stepbus_kinematics import Indices, LinkPair, Overload, RobotModel, SelfCollisions, Vector

SINGULAR_BELOW = 0.01
"""Smallest singular value of a tip's Jacobian that is accepted, with lengths in [m]."""

Verdict = Literal["reached", "not_holdable", "in_collision", "singular", "unreachable"]
"""From best to worst; of several attempts the best is returned."""

_LARGEST_STEP = 0.5
"""Of a joint in one iteration [rad]; the linear model holds no further."""


_CAUTION, _CLOSEST_CAUTION = 0.05, 0.5
"""How much of the squared error is added to the damping; for the closest pose more: the search
would swing to and fro about a stretched arm."""

_STANDSTILL = 1e-6
"""Smallest step of an iteration that still leads anywhere [rad]."""

_DAMPING = 1e-2
"""λ of the least squares [-]."""

_STARTS, _HOPELESS_AFTER = 50, 25
"""Attempts from different poses; fewer, where none of so many came to the pose."""

_ITERATIONS, _CLOSEST_ITERATIONS = 30, 600
"""Of one attempt, and for the closest pose."""

_REACHED = 1e-5
"""Errors below which a pose counts as reached [m], [rad]."""


@dataclass(frozen=True, kw_only=True)
class Solution:
    """The result of a search for one pose.

    q: of all joints, shape (n,) [rad]; where the pose is unreachable, the closest found.
    position_error [m], orientation_error [rad]: of the model at q. smallest_singular_value: of the
    tip's Jacobian at q, with lengths in [m]. overload, pair: what cannot hold, what touches.
    """

    verdict: Verdict
    q: Vector
    position_error: float = 0.0
    orientation_error: float = 0.0
    smallest_singular_value: float = math.inf
    overload: Overload | None = None
    pair: LinkPair | None = None

    def __str__(self) -> str:
        match self.verdict:
            case "unreachable":
                return (
                    f"unreachable: the closest pose is {self.position_error * 1e3:.1f} mm and "
                    f"{math.degrees(self.orientation_error):.1f}° away"
                )
            case "singular":
                least = self.smallest_singular_value
                return f"singular: the smallest singular value is {least:.4f}"
            case "in_collision":
                return f"in collision: {' would touch '.join(self.pair or ())}"
            case "not_holdable":
                return f"not holdable: {self.overload}"
            case _:
                return "reached"


class InverseKinematics:
    """Finds joint positions that bring a frame to a pose.

    q ← q + Jᵀ (J Jᵀ + (λ² + c eᵀe) I)⁻¹ e, cut at the position limits, with e the displacement
    that is left, in the axes of the base: translation [m], rotation vector [rad]. The damping
    grows with the error, so that a pose out of reach is approached without swinging (Sugihara,
    Solvability-Unconcerned Inverse Kinematics by the Levenberg-Marquardt Method, 2011, with
    c = 1/2; a smaller one is quicker where the pose can be reached). The first attempt
    starts at the given pose, the others at random ones. seed: of these. collisions: of the robot
    with itself; None: not checked.
    """

    def __init__(
        self, robot: RobotModel, *, seed: int, collisions: SelfCollisions | None = None
    ) -> None:
        self._robot = robot
        self._collisions = collisions
        self._random = np.random.Generator(np.random.PCG64(seed))

    def solve(self, tip: str, target: Any, start: Vector) -> Solution:
        """Return the first solution that nothing is wrong with, or else the best one found.

        tip: frame of the robot. target: pose of it in the robot's base, a `pinocchio.SE3`. start:
        shape (n,) [rad]; joints that do not move the tip stay there. Raises RunError for an
        unknown frame.
        """
        best = Solution(verdict="unreachable", q=start, position_error=math.inf)
        for count, q in enumerate(self._starts(tip, start), 1):
            found = self._judge(tip, self._descend(tip, target, q), target)
            best = min(best, found, key=_rank)
            is_hopeless = best.verdict == "unreachable" and count >= _HOPELESS_AFTER
            if best.verdict == "reached" or is_hopeless:
                break
        if best.verdict == "unreachable":
            closest = self._descend(tip, target, best.q, _CLOSEST_ITERATIONS, _CLOSEST_CAUTION)
            best = self._judge(tip, closest, target)
        return best

    def _starts(self, tip: str, start: Vector) -> Iterator[Vector]:
        chain, robot = self._robot.chain(tip), self._robot
        yield start
        for _ in range(_STARTS - 1):
            q = start.copy()
            q[chain] = self._random.uniform(robot.lower[chain], robot.upper[chain])
            yield q

    def _descend(
        self,
        tip: str,
        target: Any,
        start: Vector,
        iterations: int = _ITERATIONS,
        caution: float = _CAUTION,
    ) -> Vector:
        """Return where damped least squares ends, shape (n,) [rad]."""
        number, chain = self._robot.frame_id(tip), self._robot.chain(tip)
        q = start.copy()
        for _ in range(iterations):
            pose, jacobian = self._robot.jacobian(q, number)
            error = displacement(pose, target)
            if _is_there(error):
                break
            moved = self._step(q[chain], jacobian[:, chain], error, chain, caution)
            if np.abs(moved - q[chain]).max() < _STANDSTILL:
                break
            q[chain] = moved
        return q

    def _step(
        self, q: Vector, jacobian: Vector, error: Vector, chain: Indices, caution: float
    ) -> Vector:
        """Return the next positions of the chain, shape (m,) [rad]; jacobian: shape (6, m)."""
        lower, upper = self._robot.lower[chain], self._robot.upper[chain]
        damping = (_DAMPING**2 + caution * (error @ error)) * np.eye(6)
        free = np.ones(len(q), dtype=bool)
        for _ in range(2):
            part = jacobian * free
            step = part.T @ np.linalg.solve(part @ part.T + damping, error)
            step *= min(1.0, _LARGEST_STEP / max(float(np.abs(step).max()), _STANDSTILL))
            moved: Vector = np.clip(q + step, lower, upper)
            # A joint at its limit that would go further takes no part: the others make up for it.
            stuck = (moved == q) & (step != 0.0)
            if not stuck.any():
                break
            free &= ~stuck
        return moved

    def judge(self, q: Vector, moved: Indices) -> Solution:
        """Return the verdict on given joint positions, shape (n,) [rad]: collisions and strength.

        moved: the joints that must be strong enough; the others are not judged.
        """
        if self._collisions is not None and self._collisions.any(q):
            return Solution(verdict="in_collision", q=q, pair=self._collisions.pair(q))
        overload = self._robot.overload(q, moved)
        verdict: Verdict = "reached" if overload is None else "not_holdable"
        return Solution(verdict=verdict, q=q, overload=overload)

    def _judge(self, tip: str, q: Vector, target: Any) -> Solution:
        chain = self._robot.chain(tip)
        pose, jacobian = self._robot.jacobian(q, self._robot.frame_id(tip))
        error, smallest = displacement(pose, target), smallest_singular_value(jacobian[:, chain])
        if not _is_there(error):
            found = Solution(verdict="unreachable", q=q)
        elif smallest < SINGULAR_BELOW:
            found = Solution(verdict="singular", q=q)
        else:
            found = self.judge(q, chain)
        return replace(
            found,
            position_error=float(np.linalg.norm(error[:3])),
            orientation_error=float(np.linalg.norm(error[3:])),
            smallest_singular_value=smallest,
        )


def _is_there(error: Vector) -> bool:
    return bool(max(np.linalg.norm(error[:3]), np.linalg.norm(error[3:])) < _REACHED)


def smallest_singular_value(jacobian: Vector) -> float:
    """Return the smallest singular value of a Jacobian, shape (6, m), with lengths in [m]."""
    return float(np.linalg.svd(jacobian, compute_uv=False).min())


def displacement(pose: Any, target: Any) -> Vector:
    """Return the displacement between two `pinocchio.SE3`, in the axes of the base, shape (6,).

    Translation [m], then the rotation vector [rad]. In these axes a turn of the tip leaves the
    translation as it is. In the tip's own axes it does not, and the search would stop short of the
    closest pose.
    """
    turn = pose.rotation @ pin.log3(pose.rotation.T @ target.rotation)
    return np.concatenate([target.translation - pose.translation, turn])


def _rank(solution: Solution) -> tuple[int, float]:
    """Return a sort key that is smaller for a better solution."""
    miss = solution.position_error + solution.orientation_error
    load = solution.overload.required - solution.overload.available if solution.overload else 0.0
    return get_args(Verdict).index(
        solution.verdict
    ), miss if solution.verdict == "unreachable" else load
