"""From a request to a plan."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import Vector
from stepbus_participant import suggest
from stepbus_schemas import Plan, PlanRequest, Point, Poses
from stepbus_store.cause import Cause
from stepbus_store.planner.obstacles import Link, Obstacles, PlannedRobot, column
from stepbus_store.planner.outline import Outline
from stepbus_store.planner.path_search import RESOLUTION, Search, find_paths
from stepbus_store.planner.scene import Checker, Margins, Scene, Surroundings
from stepbus_store.planner.timing import Limits, Trajectory, dense, parametrize

_ROUNDING = 1e-3
"""How far a measured joint may exceed its limit [rad]."""

_AROUND = math.pi
"""How far a path may leave the range between start and goal [rad]."""

_SAME = 1e-6
"""Distance below which start and goal are the same [rad]."""

_LAST_SHARE = 0.5
"""Share of the margins that the trajectory has to keep; the spline may use up the rest."""

_LAST_RESOLUTION = 0.5
"""Resolution of the trajectory's check, as a share of the search's."""

_UPRIGHT = math.cos(0.6)
"""Of the tilt at which what is held starts to turn between the pads."""

_HEIGHT = 1.3
"""Of what lidars see, which do not see how high it is [m]."""

Seen = tuple[Point, Sequence[Outline]]
"""Pose of the base, x, y, yaw [m, rad], and what lidars see, both in the frame of odometry."""

BESIDE_RESOLUTION = 3.0
"""The same, at poses of the base other than that of the plan."""


def is_check(request: PlanRequest) -> bool:
    """Return whether a request is for the check of a path only."""
    return bool(request.path) and request.start == request.goal


def on_floor(base: Point) -> Any:
    """Return a pose of the base, x, y, yaw, as `pinocchio.SE3`."""
    return pin.SE3(pin.utils.rotate("z", base[2]), np.array([base[0], base[1], 0.0]))


class NoPlan(Exception):
    """A request without a plan; cause: one word for programs."""

    def __init__(self, cause: Cause, text: str) -> None:
        super().__init__(text)
        self.cause = cause


class Cancelled(Exception):
    """The request was cancelled."""


@dataclass(frozen=True, kw_only=True)
class PathPlanner:
    """Answers requests: by a straight path if it is free, else by a search.

    The answer depends on these fields, the request and the poses only. tip: frame that a held
    object moves with. max_checks: limit on collision checks. period: between two samples of a plan
    [s].
    """

    robot: PlannedRobot
    obstacles: Obstacles
    tip: str
    margins: Margins
    limits: Limits
    max_checks: int
    period: float
    seed: int

    def plan(
        self,
        request: PlanRequest,
        poses: Poses | None,
        cancelled: Callable[[], bool],
        map_in_world: Any,
        seen: Seen | None,
    ) -> Plan | None:
        """Return the answer to a request; None: it was cancelled meanwhile.

        poses: of the world at the time of the request. cancelled: whether the request is obsolete.
        map_in_world: pose of the frame of the request's `bases`; None: unknown. seen: by lidars.
        """
        try:
            return _Planning(self, request, poses, cancelled, map_in_world, seen).answer()
        except NoPlan as exc:
            return Plan(id=request.id, cause=exc.cause, text=str(exc))
        except Cancelled:
            return None

    def scene(
        self,
        request: PlanRequest,
        start: Vector,
        links: Mapping[str, Link],
        placements: Mapping[str, Any],
        poses: Poses,
    ) -> Scene:
        """Return the scene of a request among some links; start: as of `Scene`.

        placements: of the links, in the root link of the robot. poses: where the links of the robot
        are that move on joints of their own; others of these stand as in its posture.
        """
        tip = self.obstacles.own(poses, self.tip)
        fingers = (
            {} if tip is None else {n: self.obstacles.own(poses, n) for n in self.robot.fingers()}
        )
        around = Surroundings(
            links=links,
            placements=placements,
            held=request.held,
            touches=frozenset(request.touches),
            tip=self.tip,
            fingers={n: tip.inverse() * pose for n, pose in fingers.items() if pose is not None},
        )
        return Scene(self.robot, around, start, self.margins)


@dataclass
class _Planning:
    """The work on one request; see `PathPlanner.plan`."""

    _planner: PathPlanner
    _request: PlanRequest
    _poses: Poses | None
    _cancelled: Callable[[], bool]
    _map_in_world: Any
    _seen: Seen | None

    def __post_init__(self) -> None:
        request = self._request
        self._robot, self._obstacles = self._planner.robot, self._planner.obstacles
        self._start = self._joints("start", request.start)
        self._goal = self._joints("goal", request.goal)
        self._path = [self._joints(f"path point {k}", q) for k, q in enumerate(request.path)]
        scenes = self._make_scenes()
        self._scene = scenes.pop()
        self._beside = [scene.checker_of(scene.others) for scene in scenes]

    def _joints(self, field: str, values: list[float]) -> Vector:
        """Return a field of the request as a vector; raises NoPlan for an invalid one."""
        robot, q = self._robot, np.array(values, dtype=np.float64)
        if q.shape != (len(robot.joints),):
            expected = f"{len(robot.joints)} ({', '.join(robot.joints)})"
            raise NoPlan(Cause.BAD_REQUEST, f"{field} has {len(values)} values, not {expected}")
        inside = (robot.lower - _ROUNDING <= q) & (q <= robot.upper + _ROUNDING)
        for k in np.flatnonzero(~inside):
            name, unit = robot.joints[k], robot.unit(robot.joints[k])
            limits = f"{robot.lower[k]:.3f} to {robot.upper[k]:.3f} {unit}"
            text = f"{field}: {name} at {q[k]:.3f} {unit} is outside {limits}"
            raise NoPlan(Cause.BAD_REQUEST, text)
        return np.clip(q, robot.lower, robot.upper)

    def _make_scenes(self) -> list[Scene]:
        """Return the scene of each pose of the base; the last one is that of the plan."""
        request, links, poses, seen = self._request, self._obstacles.links, self._poses, self._seen
        if poses is None:
            raise NoPlan(Cause.BAD_REQUEST, "the poses of the world are not known yet")
        for name in dict.fromkeys([request.held, *request.touches]):
            if name and name not in links:
                text = f"the world has no link {name!r}{suggest(name, links)}"
                raise NoPlan(Cause.BAD_REQUEST, text)
        if request.bases and self._map_in_world is None:
            raise NoPlan(Cause.BAD_REQUEST, "bases need a request of the base before them")
        here = self._obstacles.placements(poses)
        columns = self._columns(*seen) if seen is not None else {}
        bases = request.bases or ([] if seen is None else [seen[0]])
        frames = [self._map_in_world * on_floor(base) for base in request.bases] or [None]
        scenes = []
        for number, frame in enumerate(frames):
            placements = self._obstacles.placements(poses, frame)
            for name in columns:
                placements[name] = on_floor(bases[number]).inverse()
            if request.held:
                placements[request.held] = here[request.held]
            among = {**links, **columns}
            scenes.append(self._planner.scene(request, self._start, among, placements, poses))
        return scenes

    def _columns(self, base: Point, seen: Sequence[Outline]) -> dict[str, Link]:
        """Return upright columns of what lidars see, in the frame of odometry.

        What the robot is in is seen of itself, or was never there.
        """
        columns, here = {}, on_floor(base).inverse()
        for number, outline in enumerate(seen):
            link = column(outline, _HEIGHT)
            around = Surroundings(links={link.name: link}, placements={link.name: here})
            scene = Scene(self._robot, around, self._start, self._planner.margins)
            if not scene.touch(self._start):
                columns[f"{link.name} ({number + 1})"] = link
        return columns

    def answer(self) -> Plan:
        """Return the plan; raises NoPlan if there is none."""
        self._robot.carry(self._request.load, self._planner.tip)
        checked = self._check_path() if self._path else ""
        if is_check(self._request):
            return self._standing(checked)
        for field, q in (("start", self._start), ("goal", self._goal)):
            if touch := self._scene.touch(q):
                raise NoPlan(Cause(f"{field}_collides"), f"at the {field}, {touch}")
        if np.linalg.norm(self._goal - self._start) < _SAME:
            return self._standing("the joints are at the goal")
        checker = self._scene.checker([self._start, self._goal])
        last = self._scene.checker([self._start, self._goal], _LAST_SHARE)
        limits, period = self._planner.limits, self._planner.period
        overloading: Vector | None = None
        for path, name in self._paths(checker):
            motion = parametrize(path, limits, self._robot.inverse_dynamics, period)
            if motion is None:
                overloading = path if overloading is None else overloading
            elif self._stays_free(motion, last):
                return self._plan(path, name, motion, checker.checks + last.checks)
        checks = checker.checks + last.checks
        if overloading is not None:
            raise NoPlan(Cause.NOT_HOLDABLE, self._overload(overloading))
        raise NoPlan(Cause.NO_PATH, f"no path from start to goal was found in {checks} checks")

    def _check_path(self) -> str:
        """Check the path that is given and return a sentence; raises NoPlan where it is blocked."""
        path = np.array([self._goal, *self._path])
        fine = dense(path, RESOLUTION * _LAST_RESOLUTION)
        checker = self._scene.path_checker(fine[0], fine[-1])
        tip = self._planner.tip
        for q in fine:
            if not checker.is_free(q):
                touch = self._scene.touch(q, checker) or "something is too close"
                here, there = (self._robot.frame_pose(row, tip).translation for row in (fine[0], q))
                far = float(np.linalg.norm(there - here))
                raise NoPlan(Cause.PATH_COLLIDES, f"{far:.3f} m from its start, {touch}")
        return f"path is free, {checker.checks} checks"

    def _paths(self, checker: Checker) -> Iterator[tuple[Vector, str]]:
        """Yield paths that keep the margins, the best first, and their names."""
        straight = np.stack([self._start, self._goal])
        if all(map(checker.is_free, dense(straight, RESOLUTION))):
            yield straight, "straight path"
        lower, upper = np.minimum(*straight) - _AROUND, np.maximum(*straight) + _AROUND
        seed = np.random.SeedSequence([self._planner.seed, self._request.id]).generate_state(1)[0]
        search = Search(
            lower=np.maximum(lower, self._robot.lower),
            upper=np.minimum(upper, self._robot.upper),
            max_checks=self._planner.max_checks,
            seed=int(seed) + 1,
        )

        is_upright = self._upright()

        def is_free(q: Vector) -> bool:
            return not self._cancelled() and is_upright(q) and checker.is_free(q)

        paths = find_paths(search, self._start, self._goal, is_free, self._cancelled)
        if self._cancelled():
            raise Cancelled
        for path in paths or ():
            yield path, "detour"

    def _upright(self) -> Callable[[Vector], bool]:
        """Return a check that what is held tilts no farther than it may, or than at the goal."""

        def up(q: Vector) -> Vector:
            """Return the vertical in the frame of the tip."""
            row: Vector = self._robot.frame_pose(q, self._planner.tip).rotation[2]
            return row

        first = up(self._start)
        least = min(_UPRIGHT, float(first @ up(self._goal)) - 1e-3)
        return lambda q: not self._request.held or bool(first @ up(q) > least)

    def _overload(self, path: Vector) -> str:
        """Return which motor is too weak for a path without a trajectory."""
        limits, rest = self._planner.limits, np.zeros(len(self._start))
        points = dense(path, RESOLUTION)
        torque = np.abs([self._robot.inverse_dynamics(q, rest, rest) for q in points]).max(axis=0)
        worst = int(np.argmax(torque / limits.effort))
        joint = self._robot.joints[worst]
        unit, least = self._robot.effort_unit(joint), f"{torque[worst]:.1f}"
        most = f"motions may use {limits.effort[worst]:.1f} {unit}"
        return f"on the path, {joint} needs {least} {unit} to stand still, but {most}"

    def _stays_free(self, motion: Trajectory, checker: Checker) -> bool:
        if self._cancelled():
            raise Cancelled
        fine = dense(motion.position, RESOLUTION * _LAST_RESOLUTION)
        coarse = dense(motion.position, RESOLUTION * BESIDE_RESOLUTION)
        return all(map(checker.is_free, fine)) and all(
            all(map(other.is_free, coarse)) for other in self._beside
        )

    def _plan(self, path: Vector, name: str, motion: Trajectory, checks: int) -> Plan:
        length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
        text = f"{name} of {length:.2f} rad in {motion.times[-1]:.2f} s, {checks} checks"
        return Plan(
            id=self._request.id,
            text=text,
            times=motion.times.tolist(),
            position=motion.position.tolist(),
            velocity=motion.velocity.tolist(),
        )

    def _standing(self, text: str) -> Plan:
        return Plan(
            id=self._request.id,
            text=text,
            times=[0.0, self._planner.period],
            position=[self._goal.tolist()] * 2,
            velocity=[[0.0] * len(self._goal)] * 2,
        )
