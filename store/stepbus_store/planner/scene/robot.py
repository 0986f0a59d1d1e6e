"""The robot that the planner moves: its model, its shapes, and how far it reaches."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import RobotModel, Vector, collision_geometry, radius_from


class PlannedRobot(RobotModel):
    """A robot with collision shapes; see `RobotModel` and `collision_geometry`.

    geometry: Pinocchio's, with the pairs of links that may touch.
    """

    def __init__(
        self,
        path: Path,
        joints: Sequence[str],
        posture: Mapping[str, float] | None = None,
        srdf: Path | None = None,
        links: Sequence[str] = (),
    ) -> None:
        super().__init__(path, joints, posture=posture, bounded=True, links=links)
        self.geometry: Any = collision_geometry(self, srdf)

    def fingers(self) -> tuple[str, ...]:
        """Return the links with shapes that move along with the joints, and on joints of their own.

        Those are at `posture`, unless one knows better.
        """
        full, own = self.full, {self.full.getJointId(name) for name in self.joints}
        names = []
        for item in self.geometry.geometryObjects:
            name = self.model.frames[item.parentFrame].name
            joint = full.frames[full.getFrameId(name, pin.FrameType.BODY)].parentJoint
            if item.parentJoint and joint not in own:
                names.append(name)
        return tuple(dict.fromkeys(names))

    def reach(self) -> tuple[Vector, float]:
        """Return a point in the root link, and how far the moving links get from it at most [m]."""
        model = self.model
        centre: Vector = np.array(model.jointPlacements[1].translation)
        furthest = 0.0
        for item in self.geometry.geometryObjects:
            item.geometry.computeLocalAABB()
            joint, far = item.parentJoint, radius_from(item.placement, item.geometry)
            while joint and model.parents[joint]:
                far += float(np.linalg.norm(model.jointPlacements[joint].translation))
                joint = model.parents[joint]
            if joint:
                far += float(np.linalg.norm(model.jointPlacements[joint].translation - centre))
                furthest = max(furthest, far)
        return centre, furthest
