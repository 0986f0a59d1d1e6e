"""Which links of a robot would touch one another, by coal."""

from pathlib import Path
from typing import Any

import pinocchio as pin

from .geometry import collision_geometry
from .model import RobotModel, Vector

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
        found: bool = pin.computeCollisions(model, data, self._broad, self._robot.in_model(q), True)
        return found

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
