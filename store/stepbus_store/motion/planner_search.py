"""Asking a planner about one candidate after the other."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stepbus_kinematics import Vector
from stepbus_schemas import Goal, Plan, PlanRequest, Point
from stepbus_store.cause import Cause
from stepbus_store.motion.follow import Candidate, JointPath
from stepbus_store.motion.outcome import Refused

_CAUSES: dict[str, Cause] = {
    Cause.BAD_REQUEST: Cause.INVALID,
    Cause.NOT_HOLDABLE: Cause.NOT_HOLDABLE,
    Cause.PATH_COLLIDES: Cause.BLOCKED,
}
"""Cause of a plan → of the goal; for all others: no_path."""

_MOST_POINTS = 500
"""Of a path that the planner checks; the message must stay below 60 kB."""

_APART = 0.02
"""Distance of these points, where the path is not too long for that [rad]."""


@dataclass(kw_only=True)
class PlannerSearch:
    """The candidates of a goal, and what the planner is asked about the current one.

    rest: where the arm waits, shape (n,) [rad]. bases: poses of the base at which the path has to
    be free; empty: where it stands. request_id, asked_at: of the newest request; its time [s].
    """

    goal: Goal
    held: str
    rest: Vector
    candidates: Iterator[Candidate]
    candidate: Candidate
    bases: Sequence[Point]
    request_id: int
    asked_at: float = 0.0
    refused: int = 0


class PlannerQueries:
    """Makes requests and takes the planner's refusals; one search at a time.

    timeout: for an answer [s of simulation]. load: mass of what the gripper holds [kg].
    """

    def __init__(self, timeout: float) -> None:
        self._timeout = timeout
        self.load = 0.0
        self._next_id = 0
        self._unsent: PlanRequest | None = None
        self.search: PlannerSearch | None = None

    def ask(self, search: PlannerSearch, t: float) -> None:
        """Ask for a path to the current candidate, and for the check of the paths from there."""
        candidate = search.candidate
        self.search, search.asked_at = search, t
        self._unsent = PlanRequest(
            id=search.request_id,
            start=search.rest.tolist(),
            goal=candidate.target.tolist(),
            held=search.held,
            touches=list(search.goal.touches),
            path=checked_points(candidate.paths),
            load=self.load,
            bases=list(search.bases),
        )

    def next_id(self) -> int:
        """Return the id of a new request."""
        self._next_id += 1
        return self._next_id - 1

    def pop(self) -> PlanRequest | None:
        """Return what to send to the planner, once."""
        request, self._unsent = self._unsent, None
        return request

    def cancel(self) -> None:
        """Forget the search; its answer will be ignored."""
        self.search, self._unsent = None, None

    def overdue(self, t: float) -> Refused | None:
        """Return the refusal of a search whose answer is late; None: it is not."""
        if self.search is None or t - self.search.asked_at <= self._timeout:
            return None
        self.cancel()
        text = f"the planner has not answered for {self._timeout:g} s"
        return Refused(Cause.NO_PLAN, f"{text}; is it running?")

    def try_next(self, search: PlannerSearch, problem: Refused, t: float) -> Refused | None:
        """Ask about the next candidate; return the refusal of the goal where there is none."""
        search.refused += 1
        candidate = next(search.candidates, None)
        if candidate is None:
            self.cancel()
            several = f"{search.refused} solutions were tried; the last: "
            tried = several if search.refused > 1 else ""
            return Refused(problem.cause, f"{tried}{problem}")
        search.candidate, search.request_id = candidate, self.next_id()
        self.ask(search, t)
        return None


def checked_points(paths: Sequence[JointPath]) -> list[list[float]]:
    """Return points along paths that follow one another, each of shape (n,) [rad]."""
    turned = [np.abs(np.diff(path.q, axis=0)).max(axis=1).sum() for path in paths]
    apart = max(_APART, float(np.sum(turned)) / _MOST_POINTS)
    points: list[list[float]] = []
    for path, far in zip(paths, turned, strict=True):
        count = max(math.ceil(far / apart), 1)
        along = np.linspace(path.u[0], path.u[-1], count + 1)[1:]
        points += [path.at(float(u))[0].tolist() for u in along]
    return points


def refusal_of(plan: Plan) -> Refused:
    """Return a planner's refusal with the cause of a goal."""
    return Refused(_CAUSES.get(plan.cause, Cause.NO_PATH), plan.text or plan.cause)
