"""Which links of a robot would touch one another, by coal."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pinocchio as pin

from stepbus_participant.config import package_path
from stepbus_participant.models import read_urdf_text
from stepbus_schemas import WiringError

from .dynamics import Vector, read_urdf
from .kinematics import Kinematics

_URL = re.compile(r"package://[^\"'<>]+")
"""A file of a package, in the text of a URDF."""

Pair = tuple[str, str]


class Collisions:
    """Collision check of a robot with itself.

    srdf: names the pairs of links that never collide or always do. margin: how close two links
    may come [m]. Meshes are replaced by their convex hulls, as the plant's physics engine does.
    Raises WiringError when meshes or SRDF cannot be read.
    """

    def __init__(self, kinematics: Kinematics, srdf: Path, margin: float) -> None:
        self._kinematics = kinematics
        self._geometry = _load(kinematics, srdf)
        self._data: Any = self._geometry.createData()
        for request in self._data.collisionRequests:
            request.security_margin = margin
        # Ten times faster than pair by pair; it takes the margin from the requests.
        self._broad = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(
            kinematics.model, self._geometry, self._data
        )

    def any(self, q: Vector) -> bool:
        """Return whether two links come too close at q, shape (n,) [rad]."""
        robot = self._kinematics
        q_model = robot.in_model(q)
        found: bool = pin.computeCollisions(robot.model, robot.data, self._broad, q_model, True)
        return found

    def pair(self, q: Vector) -> Pair | None:
        """Return the first two links that come too close at q, shape (n,) [rad]; None: none do."""
        robot = self._kinematics
        q_model = robot.in_model(q)
        if not pin.computeCollisions(
            robot.model, robot.data, self._geometry, self._data, q_model, True
        ):
            return None
        results = self._data.collisionResults
        hit = next(i for i in range(len(results)) if results[i].isCollision())
        pair = self._geometry.collisionPairs[hit]
        return self._link(pair.first), self._link(pair.second)

    def _link(self, number: int) -> str:
        frame = self._geometry.geometryObjects[number].parentFrame
        name: str = self._kinematics.model.frames[frame].name
        return name


def _load(kinematics: Kinematics, srdf: Path) -> Any:
    """Return the collision geometry of the joints that move."""
    path = kinematics.path
    full = read_urdf(path)
    try:
        geometry = _shapes(full, path)
        _use_hulls(geometry)
        geometry.addAllCollisionPairs()
        pin.removeCollisionPairs(full, geometry, str(srdf))
    except ValueError as exc:
        raise WiringError(f"{path}, {srdf}: no collision model: {exc}") from exc
    locked = [
        full.getJointId(name) for name in list(full.names)[1:] if name not in kinematics.joints
    ]
    _, moved = pin.buildReducedModel(full, [geometry], locked, pin.neutral(full))
    _drop_rigid_pairs(moved[0])
    return moved[0]


def _shapes(full: Any, path: Path) -> Any:
    """Return the collision shapes of a URDF or a `.xacro`."""
    if path.suffix.lower() == ".xacro":
        text = _URL.sub(lambda url: str(package_path(url[0])), read_urdf_text(path))
        return pin.buildGeomFromUrdfString(full, text, pin.GeometryType.COLLISION)
    # A package is a folder above the URDF, wherever it is installed.
    folders = [str(folder) for folder in path.resolve().parents]
    return pin.buildGeomFromUrdf(full, str(path), pin.GeometryType.COLLISION, package_dirs=folders)


def _drop_rigid_pairs(geometry: Any) -> None:
    """Leave out pairs of links that our joints do not move against one another."""
    # Numbers, not Pinocchio's own pairs: those refer to places of a list that shrinks.
    pairs = [(pair.first, pair.second) for pair in geometry.collisionPairs]
    links = geometry.geometryObjects
    geometry.removeAllCollisionPairs()
    for first, second in pairs:
        if links[first].parentJoint != links[second].parentJoint:
            geometry.addCollisionPair(pin.CollisionPair(first, second))


def _use_hulls(geometry: Any) -> None:
    for item in geometry.geometryObjects:
        if hasattr(item.geometry, "buildConvexHull"):
            item.geometry.buildConvexHull(True, "Qt")
            item.geometry = item.geometry.convex
