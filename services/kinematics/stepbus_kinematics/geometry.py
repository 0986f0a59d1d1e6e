"""Collision shapes of a robot, and the pairs of links that may touch."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_schemas import WiringError

from .model import RobotModel
from .urdf import with_mesh_files


def collision_geometry(robot: RobotModel, srdf: Path | None = None) -> Any:
    """Return Pinocchio's collision geometry of a robot's moving joints.

    Convex hulls stand for meshes, as in the plant's physics engine. srdf: names the pairs of links
    that never or always touch; without it these are neighbours, and links that touch where the
    robot stands. Raises WiringError where a mesh or the SRDF cannot be read.
    """
    full = robot.full
    try:
        text = with_mesh_files(robot.text, robot.path.parent)
        geometry = pin.buildGeomFromUrdfString(full, text, pin.GeometryType.COLLISION)
    except ValueError as exc:
        raise WiringError(f"{robot.path}: the collision shapes cannot be read: {exc}") from exc
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
