"""Monitors whether a planned path stays free while the robot follows it."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from stepbus_kinematics import Vector
from stepbus_schemas import Plan, PlanRequest, Poses
from stepbus_store.planner.path_search import RESOLUTION
from stepbus_store.planner.planning import BESIDE_RESOLUTION, PathPlanner, on_floor
from stepbus_store.planner.scene import Checker
from stepbus_store.planner.timing import dense

_MOVED = 0.01
"""Displacement from which an object, or the base, counts as moved [m]."""

_TURNED = 0.05
"""Rotation from which an object counts as turned [rad]."""

_MOVED_ON = 2e-3
"""Further displacement after which a moved object is checked again [m]."""

_ARRIVED = 1e-3
"""Distance from the end of its path at which the tip has arrived [m]."""

_SHARE = 0.5
"""Share of the margins that has to remain, as for a new trajectory."""

_LONGEST = 10.0
"""Multiple of its duration for which a path is monitored: near obstacles the robot is slow."""

_LONGEST_GIVEN = 30.0
"""How long a path that was only checked is monitored; its duration is not known [s]."""


class PathMonitor:
    """Monitors one path until the tip has arrived or the base moves, unless it should.

    Beside a base that drives, the path has to be free where the base is, and at all poses that are
    ahead of it. poses: of the world at the request. t: time of the plan [s]. map_in_world: pose of
    the frame of the request's `bases`.
    """

    def __init__(
        self,
        planner: PathPlanner,
        request: PlanRequest,
        plan: Plan,
        poses: Poses,
        *,
        t: float,
        map_in_world: Any,
    ) -> None:
        robot, obstacles, tip = planner.robot, planner.obstacles, planner.tip
        self._robot, self._obstacles, self._planner = robot, obstacles, planner
        self.request, self._before = request, poses
        self._until = t + _LONGEST * plan.times[-1] + (_LONGEST_GIVEN if request.path else 0.0)
        self._path = np.array([*plan.position, *request.path])
        self._checked: Mapping[str, Any] = {}
        self._tips: Vector = np.array([robot.frame_pose(q, tip).translation for q in self._path])
        self._start_of_held = obstacles.placements(poses).get(request.held)
        self._bases = [map_in_world * on_floor(base) for base in request.bases]
        if self._bases and _apart(self._bases[-1], obstacles.frame_in_world(poses)) < _MOVED:
            # The pose that it was planned for is where the base starts.
            self._bases.reverse()
        self._at = self._base_at = 0
        self.is_over = False

    def check(self, poses: Poses, t: float) -> str:
        """Return the object that blocks the path, as a sentence; empty: none. t: time [s]."""
        old, new = (self._obstacles.frame_in_world(p).translation for p in (self._before, poses))
        leaves = _distance(old, new) > _MOVED and not self._bases
        if t > self._until or leaves:
            self.is_over = True
        tip = self._obstacles.own(poses, self._planner.tip)
        if not self.is_over and tip is not None:
            # Obstacles behind the tip do not matter.
            away = np.linalg.norm(self._tips - tip.translation, axis=1).tolist()
            self._at = _nearer(away, self._at)
            self.is_over = self._at + 1 == len(away) and away[-1] < _ARRIVED
        moved = {} if self.is_over else self._moved(poses)
        self._checked = moved or self._checked
        return self._blocked(moved, poses) if moved else ""

    def _ahead(self, poses: Poses) -> list[Any]:
        """Return the poses of the base at which the path has to be free, from now on."""
        now, bases = self._obstacles.frame_in_world(poses), self._bases
        self._base_at = _nearer([_apart(base, now) for base in bases], self._base_at)
        return [now, *bases[self._base_at + 1 :]]

    def _moved(self, poses: Poses) -> Mapping[str, Any]:
        """Return the links that have moved since the plan, with their positions, if any is new."""
        touchable = {self.request.held, *self.request.touches}
        links = [link for name, link in self._obstacles.links.items() if name not in touchable]
        differ = _differ(self._before, poses)
        moved = {link.name: poses.position[link.index] for link in links if differ[link.index]}
        is_new = any(
            name not in self._checked or _distance(self._checked[name], at) > _MOVED_ON
            for name, at in moved.items()
        )
        return moved if is_new else {}

    def _blocked(self, moved: Mapping[str, Any], poses: Poses) -> str:
        share = BESIDE_RESOLUTION if self._bases else 1.0
        ahead, tip = dense(self._path[self._at :], RESOLUTION * share), self._planner.tip
        for base in self._ahead(poses):
            checker = self._checker(moved, poses, base)
            for q in ahead:
                if not checker.is_free(q):
                    hit = (n for n in moved if not self._checker([n], poses, base).is_free(q))
                    here, there = (self._robot.frame_pose(x, tip) for x in (ahead[0], q))
                    far = np.linalg.norm(there.translation - here.translation)
                    return f"{next(hit, '')} blocks the path {far:.2f} m ahead of {tip}"
        return ""

    def _checker(self, names: Iterable[str], poses: Poses, base: Any) -> Checker:
        """Return a checker against some links at their current poses, and no others.

        base: pose of the robot in the world.
        """
        held, obstacles = self.request.held, self._obstacles
        placements = obstacles.placements(poses, base)
        if held:
            # It keeps the pose in the tip that it had at the start of the path.
            placements[held] = self._start_of_held
        links = {name: obstacles.links[name] for name in (*names, held) if name}
        start = self._path[0]
        scene = self._planner.scene(self.request, start, links, placements, self._before)
        return scene.checker_of(frozenset(names), _SHARE)


def _differ(before: Poses, now: Poses) -> list[bool]:
    """Return of each link whether it has moved or turned."""
    moved = np.linalg.norm(np.subtract(before.position, now.position), axis=1) > _MOVED
    # For two unit quaternions, |a · b| is the cosine of half the angle between them.
    same = np.abs(np.sum(np.multiply(before.orientation, now.orientation), axis=1))
    differ: list[bool] = (moved | (same < math.cos(_TURNED / 2))).tolist()
    return differ


def _nearer(away: Sequence[float], at: int) -> int:
    """Return the place from which on the distances grow; at: the place so far."""
    while at + 1 < len(away) and away[at + 1] <= away[at]:
        at += 1
    return at


def _apart(a: Any, b: Any) -> float:
    """Return how far apart two poses are on the floor [m]."""
    return _distance(a.translation[:2], b.translation[:2])


def _distance(a: Any, b: Any) -> float:
    return float(np.linalg.norm(np.subtract(a, b)))
