"""The search for a path among obstacles with OMPL's RRTConnect."""

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepbus_kinematics import Vector
from stepbus_participant import need

_ompl_random = threading.Lock()
"""OMPL seeds all its random generators from one global generator."""

RESOLUTION = 0.02
"""Distance between checked positions [rad]; at 1 m from a joint, half of it is the margin."""

_LONGEST = 0.5
"""Maximum length of an extension of the search [rad]."""

_SHORTCUTS = 100
"""Attempts to remove vertices, and to take shortcuts, each."""

_CORNERS = (0.5, 0.25, 0.12, 0.06)
"""Distances from a corner at which its rounding starts; the first one without collision [rad]."""


@dataclass(frozen=True, kw_only=True)
class Search:
    """The settings of a search.

    lower, upper: bounds of the search space, shape (n,) [rad]. max_checks: limit on collision
    checks. seed: of the random numbers, > 0.
    """

    lower: Vector
    upper: Vector
    max_checks: int
    seed: int


Paths = list[Vector]
"""Versions of one path, from smooth to raw; each of shape (k, n) [rad]."""


def find_paths(
    search: Search,
    start: Vector,
    goal: Vector,
    is_free: Callable[[Vector], bool],
    is_cancelled: Callable[[], bool],
) -> Paths | None:
    """Return a path from start to goal: rounded, shortened, and raw; None: none found.

    is_cancelled: whether to stop early; the result is then meaningless.
    The same arguments give the same path in every process: OMPL seeds its random generators from a
    global one at construction, so each search seeds it anew, and searches never run concurrently.
    """
    # Loaded at the first search: where it is loaded before, OMPL reports leaks at the end (2.0.1).
    base, geometric, util = need("the planner", "ompl.base", "ompl.geometric", "ompl.util")
    with _ompl_random:
        # Silences a warning about seeding twice, which matters to existing generators only.
        util.setLogLevel(util.LogLevel.LOG_NONE)
        util.RNG.setSeed(search.seed)
        checks = _Checks(search, is_free, is_cancelled)
        return _find(base, geometric, search, (start, goal), checks)


class _Checks:
    """Checks states, and counts down. OMPL keeps it, so it must not refer to OMPL's objects."""

    def __init__(
        self, search: Search, is_free: Callable[[Vector], bool], is_cancelled: Callable[[], bool]
    ) -> None:
        self.is_free, self._is_cancelled = is_free, is_cancelled
        self._size, self._left = range(len(search.lower)), search.max_checks

    def is_valid(self, state: Any) -> bool:
        self._left -= 1
        return self.is_free(np.array([state[k] for k in self._size]))

    def is_over(self) -> bool:
        return self._left <= 0 or self._is_cancelled()


def _find(
    base: Any, geometric: Any, search: Search, ends: tuple[Vector, Vector], checks: _Checks
) -> Paths | None:
    size = len(search.lower)
    bounds = base.RealVectorBounds(size)
    for k in range(size):
        bounds.setLow(k, float(search.lower[k]))
        bounds.setHigh(k, float(search.upper[k]))
    space = base.RealVectorStateSpace(size)
    space.setBounds(bounds)
    info = base.SpaceInformation(space)
    info.setStateValidityChecker(checks.is_valid)
    # OMPL expects the resolution as a fraction of the extent of the space.
    info.setStateValidityCheckingResolution(RESOLUTION / space.getMaximumExtent())
    info.setup()
    problem = base.ProblemDefinition(info)
    problem.setStartAndGoalStates(*(_state(space, q) for q in ends))
    planner = geometric.RRTConnect(info)
    planner.setProblemDefinition(problem)
    planner.setRange(_LONGEST)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(checks.is_over))
    if not problem.hasExactSolution():
        return None
    path = problem.getSolutionPath()
    raw = _points(path, size)
    simplifier = geometric.PathSimplifier(info)
    simplifier.reduceVertices(path, _SHORTCUTS, _SHORTCUTS)
    simplifier.partialShortcutPath(path, _SHORTCUTS, _SHORTCUTS)
    short = _points(path, size)
    return [rounded(short, checks.is_free), short, raw]


def _state(space: Any, q: Vector) -> Any:
    state = space.allocState()
    for k, angle in enumerate(q.tolist()):
        state[k] = angle
    return state


def _points(path: Any, size: int) -> Vector:
    states = [path.getState(number) for number in range(path.getStateCount())]
    return np.array([[state[k] for k in range(size)] for state in states])


def rounded(path: Vector, is_free: Callable[[Vector], bool]) -> Vector:
    """Return a path, shape (k, n) [rad], with its corners rounded by collision-free parabolas."""
    corners = zip(path[:-2], path[1:-1], path[2:], strict=True)
    rounded_off = [_rounding(*points, is_free) for points in corners]
    return np.concatenate([path[:1], *rounded_off, path[-1:]])


def _rounding(
    before: Vector, corner: Vector, after: Vector, is_free: Callable[[Vector], bool]
) -> Vector:
    """Return the points around a corner, shape (k, n) [rad]."""
    back, ahead = before - corner, after - corner
    # Leave the other half of a side to its other corner, with a short straight piece between.
    most = 0.49 * min(np.linalg.norm(back), np.linalg.norm(ahead))
    for distance in _CORNERS:
        size = min(distance, float(most))
        start = corner + size / np.linalg.norm(back) * back
        end = corner + size / np.linalg.norm(ahead) * ahead
        t = np.linspace(0.0, 1.0, max(math.ceil(2 * size / RESOLUTION), 4) + 1)[:, None]
        points: Vector = (1 - t) ** 2 * start + 2 * t * (1 - t) * corner + t**2 * end
        if all(map(is_free, points)):
            return points
    return corner[None]
