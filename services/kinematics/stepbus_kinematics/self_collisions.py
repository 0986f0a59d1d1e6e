"""Collision shapes of a robot, and the pairs of links that may touch."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from stepbus_kinematics.model import RobotModel, Vector
from stepbus_models import mesh_unit
from stepbus_schemas import WiringError


def collision_geometry(robot: RobotModel, srdf: Path | None = None) -> Any:
    """Return Pinocchio's collision geometry of a robot's moving joints.

    Convex hulls stand for meshes, as in the plant's physics engine. srdf: names the pairs of links
    that never or always touch; without it these are neighbours, and links that touch where the
    robot stands. Raises WiringError where a mesh or the SRDF cannot be read.
    """
    full = robot.full
    try:
        geometry = pin.buildGeomFromUrdfString(full, robot.text, pin.GeometryType.COLLISION)
    except ValueError as exc:
        raise WiringError(f"cannot read the collision shapes of {robot.path}: {exc}") from exc
    _use_hulls(geometry)
    geometry.addAllCollisionPairs()
    _drop_harmless_pairs(full, geometry, robot.stance, srdf)
    try:
        _, (moving,) = pin.buildReducedModel(full, [geometry], robot.locked(), robot.stance)
    except ValueError as exc:
        raise WiringError(f"{robot.path}: {exc}; has a joint the name of a link?") from exc
    keep_moving_pairs(moving)
    return moving


def keep_moving_pairs(geometry: Any) -> None:
    """Leave out the pairs of links that no joint moves against one another."""
    _keep_pairs(geometry, lambda _index, first, second: first != second)


def radius_from(placement: Any, geometry: Any) -> float:
    """Return how far a shape extends at most from the origin that it is placed in [m]."""
    centre = placement.act(np.array(geometry.aabb_center))
    return float(np.linalg.norm(centre)) + float(geometry.aabb_radius)


def _use_hulls(geometry: Any) -> None:
    for item in geometry.geometryObjects:
        if (unit := mesh_unit(item.meshPath)) != 1.0:
            item.geometry = coal.MeshLoader().load(item.meshPath, item.meshScale * unit)
        if hasattr(item.geometry, "buildConvexHull"):
            item.geometry.buildConvexHull(True, "Qt")
            item.geometry = item.geometry.convex


def _drop_harmless_pairs(model: Any, geometry: Any, stance: Any, srdf: Path | None) -> None:
    if srdf is not None:
        try:
            pin.removeCollisionPairs(model, geometry, str(srdf))
        except ValueError as exc:
            raise WiringError(f"{srdf} is not an SRDF that Pinocchio can read: {exc}") from exc
        return
    data, touching = model.createData(), geometry.createData()
    pin.computeCollisions(model, data, geometry, touching, stance, False)
    hits = [result.isCollision() for result in touching.collisionResults]

    def matters(index: int, first: int, second: int) -> bool:
        neighbours = first == model.parents[second] or second == model.parents[first]
        return not (hits[index] or neighbours)

    _keep_pairs(geometry, matters)


def _keep_pairs(geometry: Any, wanted: Callable[[int, int, int], bool]) -> None:
    """Keep the pairs that are wanted by their index and the numbers of their joints."""
    joints = [item.parentJoint for item in geometry.geometryObjects]
    # As numbers: what the list holds are references that change when a pair is removed.
    pairs = [(pair.first, pair.second) for pair in geometry.collisionPairs]
    geometry.removeAllCollisionPairs()
    for index, (first, second) in enumerate(pairs):
        if wanted(index, joints[first], joints[second]):
            geometry.addCollisionPair(pin.CollisionPair(first, second))


LinkPair = tuple[str, str]


class SelfCollisions:
    """Checks a robot for collisions with itself.

    srdf: names the pairs of links that never or always collide. margin: how close two links
    may come [m]. Raises WiringError where meshes or SRDF cannot be read.
    """

    def __init__(self, robot: RobotModel, srdf: Path, margin: float) -> None:
        self._robot = robot
        self._geometry = collision_geometry(robot, srdf)
        self._data: Any = self._geometry.createData()
        for request in self._data.collisionRequests:
            request.security_margin = margin
        # Ten times faster than pair by pair; it takes the margin from the requests.
        self._broad = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(
            robot.model, self._geometry, self._data
        )

    def any(self, q: Vector) -> bool:
        """Return whether two links come too close at q, shape (n,) [rad]."""
        model, data = self._robot.model, self._robot.data
        collides: bool = pin.computeCollisions(
            model, data, self._broad, self._robot.in_model(q), True
        )
        return collides

    def pair(self, q: Vector) -> LinkPair | None:
        """Return the first two links that come too close at q, shape (n,) [rad]; None: none do."""
        model, data, there = self._robot.model, self._robot.data, self._robot.in_model(q)
        if not pin.computeCollisions(model, data, self._geometry, self._data, there, True):
            return None
        results = self._data.collisionResults
        hit = next(i for i in range(len(results)) if results[i].isCollision())
        pair = self._geometry.collisionPairs[hit]
        return self._link(pair.first), self._link(pair.second)

    def _link(self, number: int) -> str:
        frame = self._geometry.geometryObjects[number].parentFrame
        name: str = self._robot.model.frames[frame].name
        return name
