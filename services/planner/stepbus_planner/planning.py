"""From a request to a plan."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from stepbus_kinematics import Vector
from stepbus_schemas import Plan, PlanRequest, Poses

from .obstacles import World
from .robot import PlannedRobot
from .scene import Checker, Margins, Scene, Surroundings
from .search import Search, find_way
from .timing import Limits, Timed, dense, timed

_ROUNDING = 1e-3
"""How far beyond a limit a measured joint may be [rad]."""

_AROUND = math.pi
"""How far a way may swing beyond its start and goal [rad]."""

_SAME = 1e-6
"""A way shorter than this is none [rad]."""

_LAST_SHARE = 0.5
"""Share of the margins that the timed motion has to keep: rounding may have used up the rest."""

_LAST_RESOLUTION = 0.5
"""Share of the resolution in which the timed motion is checked."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """What a planner does for every request.

    tip: frame that held things move with. resolution: distance of the positions that are checked
    [rad]; at 1 m from a joint, half of it should be below the margin. longest: stretch that the
    search adds at once [rad]. max_checks: after how many the search gives up. period: between
    the times of a plan [s].
    """

    tip: str
    margins: Margins
    limits: Limits
    resolution: float = 0.02
    longest: float = 0.5
    max_checks: int = 20_000
    period: float = 0.02


class Refused(Exception):
    """There is no plan; cause: one word for programs."""

    def __init__(self, cause: str, text: str) -> None:
        super().__init__(text)
        self.cause = cause


class Cancelled(Exception):
    """Nobody wants the plan any more."""


class WayPlanner:
    """Answers requests: straight where nothing is in the way, else by a search.

    The answer follows from robot, world, task, seed, request and poses alone.
    """

    def __init__(self, robot: PlannedRobot, world: World, task: Task, seed: int) -> None:
        self._robot = robot
        self._world = world
        self._task = task
        self._seed = seed

    def plan(
        self, request: PlanRequest, poses: Poses | None, cancelled: Callable[[], bool]
    ) -> Plan | None:
        """Return the answer to a request; None: it was cancelled on the way.

        poses: of the world at the time of the request. cancelled: whether nobody wants it now.
        """
        try:
            return _Planning(self, request, poses, cancelled).answer()
        except Refused as exc:
            return Plan(id=request.id, cause=exc.cause, text=str(exc))
        except Cancelled:
            return None


class _Planning:
    """The work on one request."""

    def __init__(
        self,
        planner: WayPlanner,
        request: PlanRequest,
        poses: Poses | None,
        cancelled: Callable[[], bool],
    ) -> None:
        self._robot, self._world = planner._robot, planner._world
        self._task, self._seed = planner._task, planner._seed
        self._request = request
        self._cancelled = cancelled
        self._start = self._joints("start", request.start)
        self._goal = self._joints("goal", request.goal)
        self._scene = self._make_scene(poses)
        self._checks = 0

    def _joints(self, field: str, values: list[float]) -> Vector:
        """Return a field of the request as a vector; raises Refused for one of no use."""
        robot, q = self._robot, np.array(values, dtype=np.float64)
        if q.shape != (len(robot.joints),):
            wanted = f"{len(robot.joints)} ({', '.join(robot.joints)})"
            raise Refused("bad_request", f"{field} has {len(values)} values, not {wanted}")
        inside = (robot.lower - _ROUNDING <= q) & (q <= robot.upper + _ROUNDING)
        for name, value, low, high, fits in zip(
            robot.joints, values, robot.lower, robot.upper, inside, strict=True
        ):
            if not fits:
                raise Refused(
                    "bad_request",
                    f"{field}: {name} at {value:.3f} rad is outside {low:.3f} to {high:.3f} rad",
                )
        return np.clip(q, robot.lower, robot.upper)

    def _make_scene(self, poses: Poses | None) -> Scene:
        request, links = self._request, self._world.links
        if poses is None:
            raise Refused("bad_request", "the poses of the world are not known yet")
        for name in dict.fromkeys([request.held, *request.touches]):
            if name and name not in links:
                close = difflib.get_close_matches(name, links, n=1)
                hint = f"did you mean {close[0]!r}?" if close else f"it has {len(links)} others"
                raise Refused("bad_request", f"the world has no link {name!r}; {hint}")
        around = Surroundings(
            links=links,
            placements=self._world.placements(poses),
            held=request.held,
            touches=frozenset(request.touches),
            tip=self._task.tip,
        )
        return Scene(self._robot, around, self._start, self._task.margins)

    def answer(self) -> Plan:
        """Return the plan; raises Refused where there is none."""
        self._refuse_touching("start", self._start)
        self._refuse_touching("goal", self._goal)
        if np.linalg.norm(self._goal - self._start) < _SAME:
            return self._standing()
        checker = self._scene.checker([self._start, self._goal])
        last = self._scene.checker([self._start, self._goal], _LAST_SHARE)
        heaviest: Vector | None = None
        for way, sort in self._ways(checker):
            motion = timed(way, self._task.limits, self._robot.inverse_dynamics, self._task.period)
            if motion is None:
                heaviest = way if heaviest is None else heaviest
            elif self._stays_free(motion, last):
                return self._found(way, sort, motion, checker.checks + last.checks)
        checks = checker.checks + last.checks
        if heaviest is not None:
            raise Refused("not_holdable", self._overload(heaviest))
        raise Refused("no_way", f"no way from start to goal was found in {checks} checks")

    def _refuse_touching(self, field: str, q: Vector) -> None:
        touch = self._scene.touch(q)
        if touch is not None:
            raise Refused(f"{field}_collides", f"at the {field}, {touch}")

    def _ways(self, checker: Checker) -> Iterator[tuple[Vector, str]]:
        """Return ways that keep the margins, the best first, and what to call them."""
        straight = np.stack([self._start, self._goal])
        if all(map(checker.is_free, dense(straight, self._task.resolution))):
            yield straight, "straight way"
        lower, upper = np.minimum(*straight) - _AROUND, np.maximum(*straight) + _AROUND
        seed = np.random.SeedSequence([self._seed, self._request.id]).generate_state(1)[0]
        search = Search(
            lower=np.maximum(lower, self._robot.lower),
            upper=np.minimum(upper, self._robot.upper),
            resolution=self._task.resolution,
            longest=self._task.longest,
            max_checks=self._task.max_checks,
            seed=int(seed) + 1,
        )

        def is_free(q: Vector) -> bool:
            return not self._cancelled() and checker.is_free(q)

        ways = find_way(search, self._start, self._goal, is_free, self._cancelled)
        if self._cancelled():
            raise Cancelled
        for way in ways or ():
            yield way, "way around"

    def _overload(self, way: Vector) -> str:
        """Return which motor is too weak for a way that cannot be timed."""
        limits, rest = self._task.limits, np.zeros(len(self._start))
        points = dense(way, self._task.resolution)
        torque = np.abs([self._robot.inverse_dynamics(q, rest, rest) for q in points]).max(axis=0)
        worst = int(np.argmax(torque / limits.effort))
        return (
            f"on the way, {self._robot.joints[worst]} needs {torque[worst]:.1f} N·m to stand "
            f"still, and a motion may use {limits.effort[worst]:.1f} N·m"
        )

    def _stays_free(self, motion: Timed, checker: Checker) -> bool:
        if self._cancelled():
            raise Cancelled
        fine = dense(motion.position, self._task.resolution * _LAST_RESOLUTION)
        return all(map(checker.is_free, fine))

    def _found(self, way: Vector, sort: str, motion: Timed, checks: int) -> Plan:
        length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
        text = f"{sort} of {length:.2f} rad in {motion.times[-1]:.2f} s, {checks} checks"
        return Plan(
            id=self._request.id,
            text=text,
            times=motion.times.tolist(),
            position=motion.position.tolist(),
            velocity=motion.velocity.tolist(),
        )

    def _standing(self) -> Plan:
        return Plan(
            id=self._request.id,
            text="the goal is where the joints are",
            times=[0.0, self._task.period],
            position=[self._goal.tolist()] * 2,
            velocity=[[0.0] * len(self._goal)] * 2,
        )
