"""The search for a way among obstacles, by OMPL's RRTConnect."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepbus_kinematics import Vector

from .libraries import need

MODULES = ("ompl.base", "ompl.geometric", "ompl.util")
"""What it is made of."""

_ompl_random = threading.Lock()
"""OMPL takes the seeds of all its generators from one of the whole process."""

_SHORTCUTS = 100
"""Attempts to leave out corners, and to cut across, each."""

_CORNERS = (0.5, 0.25, 0.12, 0.06)
"""How far from a corner its rounding begins, the largest that touches nothing [rad]."""


@dataclass(frozen=True, kw_only=True)
class Search:
    """What a search for a way works with.

    lower, upper: the box that is searched, shape (n,) [rad]. resolution: distance of the
    positions that are checked [rad]. longest: stretch that the search adds at once [rad].
    max_checks: after how many of them it gives up. seed: of all that is drawn at random, > 0.
    """

    lower: Vector
    upper: Vector
    resolution: float
    longest: float
    max_checks: int
    seed: int


Ways = list[Vector]
"""The same way, from round to raw; each of shape (k, n) [rad]."""


def find_way(
    search: Search,
    start: Vector,
    goal: Vector,
    is_free: Callable[[Vector], bool],
    is_cancelled: Callable[[], bool],
) -> Ways | None:
    """Return a way from start to goal: smoothed, shortened, and as it was found; None: none.

    is_cancelled: whether nobody wants it any more; it then ends soon, with anything.
    The same arguments give the same way in every process. OMPL's generators are seeded when they
    are made, from one generator of the process; so it is seeded anew here, and no two searches of
    a process run at once.
    """
    base, geometric, util = need(*MODULES)
    with _ompl_random:
        # It would complain that it is not the first seed; that matters to older generators only.
        util.setLogLevel(util.LogLevel.LOG_NONE)
        util.RNG.setSeed(search.seed)
        return _Finder(base, geometric, search, is_free, is_cancelled).find(start, goal)


class _Finder:
    def __init__(
        self,
        base: Any,
        geometric: Any,
        search: Search,
        is_free: Callable[[Vector], bool],
        is_cancelled: Callable[[], bool],
    ) -> None:
        self._base, self._geometric, self._search = base, geometric, search
        self._is_free, self._is_cancelled = is_free, is_cancelled
        self._size = range(len(search.lower))
        self._left = search.max_checks
        bounds = base.RealVectorBounds(len(search.lower))
        for k in self._size:
            bounds.setLow(k, float(search.lower[k]))
            bounds.setHigh(k, float(search.upper[k]))
        self._space = base.RealVectorStateSpace(len(search.lower))
        self._space.setBounds(bounds)
        self._info = base.SpaceInformation(self._space)
        self._info.setStateValidityChecker(self._is_valid)
        # OMPL wants the distance of its checks as a share of the whole space.
        share = search.resolution / self._space.getMaximumExtent()
        self._info.setStateValidityCheckingResolution(share)
        self._info.setup()

    def _is_valid(self, state: Any) -> bool:
        self._left -= 1
        return self._is_free(np.array([state[k] for k in self._size]))

    def _state(self, q: Vector) -> Any:
        state = self._space.allocState()
        for k in self._size:
            state[k] = float(q[k])
        return state

    def _is_over(self) -> bool:
        return self._left <= 0 or self._is_cancelled()

    def find(self, start: Vector, goal: Vector) -> Ways | None:
        problem = self._base.ProblemDefinition(self._info)
        problem.setStartAndGoalStates(self._state(start), self._state(goal))
        planner = self._geometric.RRTConnect(self._info)
        planner.setProblemDefinition(problem)
        planner.setRange(self._search.longest)
        planner.setup()
        planner.solve(self._base.PlannerTerminationCondition(self._is_over))
        if not problem.hasExactSolution():
            return None
        path = problem.getSolutionPath()
        ways = [self._points(path)]
        simplifier = self._geometric.PathSimplifier(self._info)
        simplifier.reduceVertices(path, _SHORTCUTS, _SHORTCUTS)
        simplifier.partialShortcutPath(path, _SHORTCUTS, _SHORTCUTS)
        ways.append(self._points(path))
        ways.append(rounded(ways[-1], self._search.resolution, self._is_free))
        return ways[::-1]

    def _points(self, path: Any) -> Vector:
        states = [path.getState(number) for number in range(path.getStateCount())]
        return np.array([[state[k] for k in self._size] for state in states])


def rounded(way: Vector, resolution: float, is_free: Callable[[Vector], bool]) -> Vector:
    """Return a way with its corners rounded by parabolas where nothing is in their way.

    way: shape (k, n) [rad]. resolution: distance of the new points at most [rad].
    """
    points = [way[:1]]
    for before, corner, after in zip(way[:-2], way[1:-1], way[2:], strict=True):
        points.append(_rounding(before, corner, after, resolution, is_free))
    return np.concatenate([*points, way[-1:]])


def _rounding(
    before: Vector,
    corner: Vector,
    after: Vector,
    resolution: float,
    is_free: Callable[[Vector], bool],
) -> Vector:
    """Return the points around a corner, shape (k, n) [rad]."""
    back, on = before - corner, after - corner
    # Half of a side is left to the corner at its other end; a little stays straight between them.
    most = 0.49 * min(np.linalg.norm(back), np.linalg.norm(on))
    for wanted in _CORNERS:
        size = min(wanted, float(most))
        begin = corner + size / np.linalg.norm(back) * back
        end = corner + size / np.linalg.norm(on) * on
        t = np.linspace(0.0, 1.0, max(math.ceil(2 * size / resolution), 4) + 1)[:, None]
        points: Vector = (1 - t) ** 2 * begin + 2 * t * (1 - t) * corner + t**2 * end
        if all(map(is_free, points)):
            return points
    return corner[None]
