"""The scene of one request: the robot, the obstacles, and which pairs to check."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import Vector, radius_from
from stepbus_store.planner.obstacles import Link, PlannedRobot

_CLOSER = 0.5
"""Share of the gap at the start or the goal to keep if that gap is below the margin."""

_DEEPER = 5e-4
"""How much deeper a held object may penetrate what it stands on [m]."""


@dataclass(frozen=True, kw_only=True)
class Margins:
    """Minimum distances [m].

    robot: of the robot to obstacles and to itself. path: the same, on a path that is only checked.
    held: of a held object to obstacles and the robot. standing: how deep a held object may
    penetrate what it stands on, at start and goal.
    """

    robot: float = 0.01
    path: float = 0.003
    held: float = 0.003
    standing: float = 0.003


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """The obstacles at the time of a request.

    links: by name. placements: of each, in the root link of the robot. held: name of the link in
    the gripper, or empty. touches: names of links that the robot may touch. tip: frame of the robot
    that the held link moves with. fingers: poses in it of the robot's links that stand elsewhere
    than in its posture.
    """

    links: Mapping[str, Link]
    placements: Mapping[str, Any]
    held: str = ""
    touches: frozenset[str] = frozenset()
    tip: str = ""
    fingers: Mapping[str, Any] = field(default_factory=dict)


class Scene:
    """Checks joint positions for collisions.

    start: current joint positions, shape (n,) [rad]; a held object keeps its pose in the tip from
    there. links: name of the link of each shape. Obstacles out of reach are left out.
    """

    def __init__(
        self, robot: PlannedRobot, around: Surroundings, start: Vector, margins: Margins
    ) -> None:
        self._robot = robot
        self._data = robot.model.createData()
        self._geometry = robot.geometry.copy()
        self.links = [
            robot.model.frames[item.parentFrame].name for item in robot.geometry.geometryObjects
        ]
        self._place_fingers(around)
        held = self._add_held(around, start)
        self.others = frozenset(around.links) - {around.held}
        self._pair(held, self._add_world(around, held), around.touches)
        pairs = self._geometry.collisionPairs
        with_held = np.array([not {pair.first, pair.second}.isdisjoint(held) for pair in pairs])
        self._with_held = with_held
        self._allowed = np.where(with_held, margins.held, margins.robot)
        self._on_path = np.where(with_held, margins.held, margins.path)
        self._deepest = np.where(with_held, -margins.standing, 0.0)
        self._distances = self._geometry.createData()

    def _place_fingers(self, around: Surroundings) -> None:
        for item, name in zip(self._geometry.geometryObjects, self.links, strict=True):
            if name in around.fingers:
                frames = self._robot.model.frames
                in_link = frames[item.parentFrame].placement.inverse() * item.placement
                tip = frames[self._robot.frame_id(around.tip)]
                item.placement = tip.placement * around.fingers[name] * in_link

    def _add_held(self, around: Surroundings, start: Vector) -> list[int]:
        """Attach the shapes of the held link to the joint that moves the tip."""
        if not around.held:
            return []
        robot = self._robot
        frame = robot.model.frames[robot.frame_id(around.tip)]
        in_tip = robot.frame_pose(start, around.tip).inverse() * around.placements[around.held]
        return self._add(around.links[around.held], frame.parentJoint, frame.placement * in_tip)

    def _add_world(self, around: Surroundings, held: Iterable[int]) -> list[int]:
        centre, reach = self._robot.reach()
        for number in held:
            shape = self._geometry.geometryObjects[number].geometry
            reach += 2 * float(shape.aabb_radius)
        near: list[int] = []
        for name, link in around.links.items():
            if name != around.held:
                placement = around.placements[name]
                away = float(np.linalg.norm(placement.translation - centre))
                if any(away < reach + radius_from(s.placement, s.geometry) for s in link.shapes):
                    near += self._add(link, 0, placement)
        return near

    def _add(self, link: Link, joint: int, placement: Any) -> list[int]:
        numbers = []
        for shape in link.shapes:
            name = f"world/{len(self.links)}"
            item = pin.GeometryObject(name, joint, placement * shape.placement, shape.geometry)
            numbers.append(self._geometry.addGeometryObject(item))
            self.links.append(link.name)
        return numbers

    def _pair(self, held: list[int], world: list[int], touches: frozenset[str]) -> None:
        """Check the moving robot against the obstacles, and the held object against both."""
        joints = [item.parentJoint for item in self._geometry.geometryObjects]
        own = range(self._robot.geometry.ngeoms)
        moving, pairs = [mine for mine in own if joints[mine]], []
        for other in world:
            if self.links[other] not in touches:
                pairs += [(mine, other) for mine in moving]
            pairs += [(part, other) for part in held]
        pairs += [(mine, part) for part in held for mine in own if joints[mine] != joints[part]]
        for one, other in pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(one, other))

    def touch(self, q: Vector, checker: Checker | None = None) -> str:
        """Return which two links penetrate most at q, shape (n,) [rad]; empty: none touch.

        checker: whose margins count, instead of those of links that touch.
        """
        margins = self._deepest if checker is None else checker.margins
        distance = self._distances_at(q)
        worst = int(np.argmin(distance - margins)) if len(distance) else -1
        if worst < 0 or distance[worst] > margins[worst]:
            return ""
        pair, mm = self._geometry.collisionPairs[worst], distance[worst] * 1e3
        first, second = self.links[pair.first], self.links[pair.second]
        if mm > 0.0:
            return f"{first} comes within {mm:.1f} mm of {second}"
        return f"{first} touches {second} ({-mm:.1f} mm deep)"

    def _distances_at(self, q: Vector) -> Vector:
        robot = self._robot
        pin.computeDistances(
            robot.model, self._data, self._geometry, self._distances, robot.in_model(q)
        )
        return np.array([result.min_distance for result in self._distances.distanceResults])

    def checker(self, ends: Iterable[Vector], share: float = 1.0) -> Checker:
        """Return a checker for positions between two collision-free ends.

        Pairs closer than the margin at an end may be almost as close on the path. share: of every
        margin, to be kept.
        """
        allowed = self._allowed
        for q in ends:
            allowed = np.minimum(allowed, self._closer(q))
        wanted = np.where(allowed > 0, allowed * share, allowed)
        return Checker(self._robot, self._geometry, wanted)

    def _closer(self, q: Vector) -> Vector:
        """Return how close pairs may come that are close at q already [m]."""
        gap = self._distances_at(q)
        closer: Vector = np.where(gap > 0, gap * _CLOSER, gap - _DEEPER)
        return closer

    def path_checker(self, start: Vector, end: Vector) -> Checker:
        """Return a checker for a path that is given.

        What is closer than its margin at the start may stay so; a held object also at the end.
        """
        allowed = np.minimum(self._on_path, self._closer(start))
        at_end = np.where(self._with_held, self._closer(end), np.inf)
        return Checker(self._robot, self._geometry, np.minimum(allowed, at_end))

    def checker_of(self, names: frozenset[str], share: float = 1.0) -> Checker:
        """Return a checker against some of the obstacles only, whatever start and goal are.

        share: of every margin, to be kept.
        """
        geometry = self._geometry.copy()
        geometry.removeAllCollisionPairs()
        wanted = []
        for index, pair in enumerate(self._geometry.collisionPairs):
            if not names.isdisjoint((self.links[pair.first], self.links[pair.second])):
                geometry.addCollisionPair(pin.CollisionPair(pair.first, pair.second))
                wanted.append(self._allowed[index] * share)
        return Checker(self._robot, geometry, np.array(wanted))


class Checker:
    """Fast check whether any pair is closer than its margin.

    margins: of each pair, shape (pairs,) [m].
    """

    def __init__(self, robot: PlannedRobot, geometry: Any, margins: Vector) -> None:
        self._robot = robot
        self.margins = margins
        self._data = robot.model.createData()
        results = geometry.createData()
        for request, margin in zip(results.collisionRequests, margins, strict=True):
            request.security_margin = float(margin)
        # The manager does not own them; without these references it would read freed memory.
        self._owned = (geometry, results)
        # Faster than trees for tens of shapes: 31 µs instead of 59 µs for a UR5 and 30 shapes.
        self._broad = pin.BroadPhaseManager_NaiveCollisionManager(robot.model, geometry, results)
        self.checks = 0

    def is_free(self, q: Vector) -> bool:
        """Return whether all pairs keep their margins at q, shape (n,) [rad]."""
        self.checks += 1
        robot = self._robot
        collides: bool = pin.computeCollisions(
            robot.model, self._data, self._broad, robot.in_model(q), True
        )
        return not collides
