"""Looks whether a way that was found is still free while the robot goes along it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepbus_kinematics import Vector
from stepbus_schemas import Plan, PlanRequest, Poses

from .obstacles import World
from .planning import Task
from .robot import PlannedRobot
from .scene import Checker, Scene, Surroundings
from .timing import dense

_MOVED = 0.01
"""From so far on, a thing has moved, and so has the base [m]."""

_TURNED = 0.05
"""From so far on, a thing has turned [rad]."""

_MOVED_ON = 2e-3
"""A thing that has moved is looked at again when it has moved on by so much [m]."""

_ARRIVED = 1e-3
"""So near to the end of its way, the tip has arrived [m]."""

_SHARE = 0.5
"""Share of the margins that has to be left, as for a motion that is new."""

_LONGEST = 10.0
"""A way is watched for so many times its duration: near things it is gone slowly."""


@dataclass(frozen=True, kw_only=True)
class Way:
    """A way that was found.

    poses: those that it was planned with. last_step: after it nobody goes this way any more.
    """

    request: PlanRequest
    plan: Plan
    poses: Poses
    last_step: int


def last_step(plan: Plan, step: int, period: float) -> int:
    """Return until which step a plan of a step is watched; period: between two steps [s]."""
    return step + math.ceil(_LONGEST * plan.times[-1] / period)


class WayWatch:
    """Watches one way, from its plan on until the tip has arrived, or the base moves."""

    def __init__(self, robot: PlannedRobot, world: World, task: Task, way: Way) -> None:
        request, poses = way.request, way.poses
        self._robot, self._world, self._task = robot, world, task
        self._request, self._before, self._last_step = request, poses, way.last_step
        self._way = np.array(way.plan.position)
        self._looked_at: Mapping[str, Any] = {}
        self._tip_at = world.place_of(task.tip)
        self._tips: Vector = np.array(
            [robot.frame_pose(q, task.tip).translation for q in self._way]
        )
        self._start_of_held = world.placements(poses).get(request.held)
        self._at = 0
        self.is_over = False

    def look(self, poses: Poses, step: int) -> str:
        """Return what is in the way now, as a sentence; empty: nothing."""
        if step > self._last_step or self._world.base_moved(self._before, poses) > _MOVED:
            self.is_over = True
        if not self.is_over and self._tip_at is not None:
            self._follow(self._world.placement(poses, self._tip_at).translation)
        if self.is_over:
            return ""
        moved = self._moved(poses)
        if not moved:
            return ""
        self._looked_at = moved
        return self._blocked(moved, poses)

    def _follow(self, tip: Vector) -> None:
        """Find how far the tip has come on its way; behind it nothing matters any more."""
        away = np.linalg.norm(self._tips - tip, axis=1)
        while self._at + 1 < len(away) and away[self._at + 1] <= away[self._at]:
            self._at += 1
        self.is_over = self._at + 1 == len(away) and bool(away[-1] < _ARRIVED)

    def _moved(self, poses: Poses) -> Mapping[str, Any]:
        """Return what has moved since the plan, with its pose, if that is new."""
        request = self._request
        soft = {request.held, *request.touches}
        links = [link for name, link in self._world.links.items() if name not in soft]
        moved = {
            link.name: poses.position[link.place]
            for link in links
            if _differ(self._before, poses, link.place)
        }
        is_new = any(
            name not in self._looked_at or _gap(self._looked_at[name], at) > _MOVED_ON
            for name, at in moved.items()
        )
        return moved if is_new else {}

    def _blocked(self, moved: Mapping[str, Any], poses: Poses) -> str:
        checker = self._checker(moved, poses)
        ahead = dense(self._way[self._at :], self._task.resolution)
        hit = next((q for q in ahead if not checker.is_free(q)), None)
        if hit is None:
            return ""
        which = next((n for n in moved if not self._checker([n], poses).is_free(hit)), "")
        place = self._robot.frame_pose(hit, self._task.tip).translation
        here = self._robot.frame_pose(ahead[0], self._task.tip).translation
        return (
            f"{which} has come into the way, {np.linalg.norm(place - here):.2f} m ahead of "
            f"{self._task.tip}"
        )

    def _checker(self, names: Iterable[str], poses: Poses) -> Checker:
        """Return a check against some things where they are now, and nothing else."""
        held, world = self._request.held, self._world
        placements = world.placements(poses)
        if held:
            # It keeps its place in the tip, as it was at the start of the way.
            placements[held] = self._start_of_held
        around = Surroundings(
            links={name: world.links[name] for name in (*names, held) if name},
            placements=placements,
            held=held,
            touches=frozenset(self._request.touches),
            tip=self._task.tip,
        )
        scene = Scene(self._robot, around, self._way[0], self._task.margins)
        return scene.checker_of(frozenset(names), _SHARE)


def _differ(before: Poses, now: Poses, place: int) -> bool:
    """Return whether a link has moved or turned."""
    if _gap(before.position[place], now.position[place]) > _MOVED:
        return True
    # For two unit quaternions, |a · b| is the cosine of half the angle between them.
    same = abs(float(np.dot(before.orientation[place], now.orientation[place])))
    return same < math.cos(_TURNED / 2)


def _gap(a: Any, b: Any) -> float:
    return float(np.linalg.norm(np.subtract(a, b)))
