"""Inverse kinematics: damped least squares with restarts, and what is wrong with a pose."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
import pinocchio as pin

from stepbus_kinematics import Indices, LinkPair, Overload, RobotModel, SelfCollisions, Vector

SINGULAR_BELOW = 0.01
"""Smallest singular value of a tip's Jacobian that is accepted, with lengths in [m]."""

Verdict = Literal["reached", "not_holdable", "in_collision", "singular", "unreachable"]
_WORSE: tuple[Verdict, ...] = (
    "reached", "not_holdable", "in_collision", "singular", "unreachable",
)  # fmt: skip
"""From best to worst; of several attempts the best is returned."""

_LARGEST_STEP = 0.5
"""Of a joint in one iteration [rad]; the linear model holds no further."""


class _Pace(NamedTuple):
    """Times as many iterations, and how much of the squared error is added to the damping."""

    rounds: int
    caution: float


_QUICK = _Pace(1, 0.05)
_CLOSEST = _Pace(20, 0.5)
"""For the closest pose: the quick pace would swing to and fro about a stretched arm."""

_STANDSTILL = 1e-6
"""Smallest step of an iteration that still leads anywhere [rad]."""

_DAMPING = 1e-2
"""λ of the least squares [-]."""

_STARTS, _HOPELESS_AFTER = 50, 25
"""Attempts from different poses; fewer, where none of so many came to the pose."""

_ITERATIONS = 30
"""Of one attempt."""

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
                return (
                    f"singular: the smallest singular value is {self.smallest_singular_value:.4f}"
                )
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
        attempts = (
            self._judge(tip, self._descend(tip, target, q), target)
            for q in self._starts(tip, start)
        )
        best, count = next(attempts), 1
        while best.verdict != "reached":
            if best.verdict == "unreachable" and count >= _HOPELESS_AFTER:
                break
            solution = next(attempts, None)
            if solution is None:
                break
            count += 1
            best = min(best, solution, key=_rank)
        if best.verdict == "unreachable":
            closest = self._descend(tip, target, best.q, _CLOSEST)
            best = self._judge(tip, closest, target)
        return best

    def _starts(self, tip: str, start: Vector) -> Iterator[Vector]:
        chain, robot = self._robot.chain(tip), self._robot
        yield start
        for _ in range(_STARTS - 1):
            q = start.copy()
            q[chain] = self._random.uniform(robot.lower[chain], robot.upper[chain])
            yield q

    def _descend(self, tip: str, target: Any, start: Vector, pace: _Pace = _QUICK) -> Vector:
        """Return where damped least squares ends, shape (n,) [rad]."""
        robot = self._robot
        number, chain = robot.frame_id(tip), robot.chain(tip)
        q = start.copy()
        for _ in range(_ITERATIONS * pace.rounds):
            pose, jacobian = robot.jacobian(q, number)
            error = _displacement(pose, target)
            if self._is_there(error):
                break
            moved = self._step(q[chain], jacobian[:, chain], error, chain, pace.caution)
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

    def _is_there(self, error: Vector) -> bool:
        return bool(max(np.linalg.norm(error[:3]), np.linalg.norm(error[3:])) < _REACHED)

    def judge(self, q: Vector, moved: Indices) -> Solution:
        """Return the verdict on given joint positions, shape (n,) [rad].

        moved: the joints that must be strong enough; the others are not judged.
        """
        return self._judged(q, "reached", moved)

    def _judge(self, tip: str, q: Vector, target: Any) -> Solution:
        pose, jacobian = self._robot.jacobian(q, self._robot.frame_id(tip))
        error = _displacement(pose, target)
        chain = self._robot.chain(tip)
        part = jacobian[:, chain]
        smallest = float(np.linalg.svd(part, compute_uv=False).min())
        verdict: Verdict = "reached" if self._is_there(error) else "unreachable"
        if verdict == "reached" and smallest < SINGULAR_BELOW:
            verdict = "singular"
        return replace(
            self._judged(q, verdict, chain),
            position_error=float(np.linalg.norm(error[:3])),
            orientation_error=float(np.linalg.norm(error[3:])),
            smallest_singular_value=smallest,
        )

    def _judged(self, q: Vector, verdict: Verdict, moved: Indices) -> Solution:
        """Return a solution; what is reached is checked for collisions and strength."""
        overload, pair = None, None
        if verdict == "reached":
            if self._collisions is not None and self._collisions.any(q):
                verdict, pair = "in_collision", self._collisions.pair(q)
            elif (overload := self._robot.overload(q, moved)) is not None:
                verdict = "not_holdable"
        return Solution(verdict=verdict, q=q, overload=overload, pair=pair)


def _displacement(pose: Any, target: Any) -> Vector:
    """Return the displacement between two `pinocchio.SE3`, in the axes of the base, shape (6,).

    In these axes a turn of the tip leaves the translation as it is. In the tip's own axes it does
    not, and the search would stop short of the closest pose.
    """
    turn = pose.rotation @ pin.log3(pose.rotation.T @ target.rotation)
    return np.concatenate([target.translation - pose.translation, turn])


def _rank(solution: Solution) -> tuple[int, float]:
    """Return a sort key that is smaller for a better solution."""
    miss = solution.position_error + solution.orientation_error
    load = solution.overload.required - solution.overload.available if solution.overload else 0.0
    return _WORSE.index(solution.verdict), miss if solution.verdict == "unreachable" else load
