"""The robot that ways are planned for: joints, limits, shapes, torques."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from stepbus_participant.config import package_path
from stepbus_participant.models import read_urdf_text
from stepbus_participant.settings import nearest
from stepbus_schemas import WiringError

Vector = NDArray[np.float64]

_URL = re.compile(r"package://[^\"'<>]+")


class PlannedRobot:
    """A robot of which some joints are planned for, and all others stand still.

    path: URDF or xacro. joints: those that move, in the order of every vector of shape (n,).
    posture: position of joints that stand still [rad or m]; those not named are at neutral.
    srdf: names the pairs of links that never or always touch; without it these are the
    neighbours and those that touch in that posture with all other joints at neutral.
    links: which it has to have.

    lower, upper: limits of the joints [rad]. velocity_limit, effort_limit: the URDF's [rad/s,
    N·m]. geometry: Pinocchio's, with convex hulls instead of meshes, and the pairs of links that
    may touch. Raises WiringError with what is wrong with the files or the joints.
    """

    def __init__(
        self,
        path: Path,
        joints: Sequence[str],
        posture: Mapping[str, float] | None = None,
        srdf: Path | None = None,
        links: Sequence[str] = (),
    ) -> None:
        text = _URL.sub(lambda url: str(package_path(url[0])), read_urdf_text(path))
        try:
            full = pin.buildModelFromXML(text)
            geometry = pin.buildGeomFromUrdfString(full, text, pin.GeometryType.COLLISION)
        except ValueError as exc:
            raise WiringError(f"{path} is not a URDF that Pinocchio can read: {exc}") from exc
        self.path = path
        self.joints = tuple(joints)
        problems = [*_joint_problems(full, joints, posture or {}, path)]
        problems += [text for name in links if (text := _link_problem(full, name, path))]
        if problems:
            raise WiringError("\n".join(problems))
        _use_hulls(geometry)
        still = _still_posture(full, posture or {})
        geometry.addAllCollisionPairs()
        _drop_harmless_pairs(full, geometry, still, srdf)
        locked = [full.getJointId(name) for name in list(full.names)[1:] if name not in joints]
        try:
            self.model, (self.geometry,) = pin.buildReducedModel(full, [geometry], locked, still)
        except ValueError as exc:
            raise WiringError(f"{path}: {exc}; has a joint the name of a link?") from exc
        drop_rigid_pairs(self.geometry)
        self._data = self.model.createData()
        self._read_limits()

    def _read_limits(self) -> None:
        model, ids = self.model, [self.model.getJointId(name) for name in self.joints]
        self._in_model = np.array([model.idx_qs[i] for i in ids], dtype=np.intp)
        self.lower: Vector = np.array(model.lowerPositionLimit)[self._in_model]
        self.upper: Vector = np.array(model.upperPositionLimit)[self._in_model]
        self.velocity_limit: Vector = np.array(model.upperVelocityLimit)[self._in_model]
        self.effort_limit: Vector = np.array(model.upperEffortLimit)[self._in_model]

    def in_model(self, q: Vector) -> Vector:
        """Return a vector of shape (n,) in the order of Pinocchio's model."""
        out = np.empty(len(q))
        out[self._in_model] = q
        return out

    def place(self, q: Vector, frame: str) -> Any:
        """Return the pose of a link in the root link at q, as a `pinocchio.SE3`."""
        pin.framesForwardKinematics(self.model, self._data, self.in_model(q))
        return self._data.oMf[self.frame_id(frame)].copy()

    def frame_id(self, name: str) -> int:
        """Return Pinocchio's number of a link; raises WiringError for an unknown one."""
        problem = _link_problem(self.model, name, self.path)
        if problem:
            raise WiringError(problem)
        number: int = self.model.getFrameId(name, pin.FrameType.BODY)
        return number

    def inverse_dynamics(self, q: Vector, v: Vector, a: Vector) -> Vector:
        """Return the torques of a motion, shape (n,) [N·m]; q, v, a: shape (n,) [rad, s]."""
        q, v, a = self.in_model(q), self.in_model(v), self.in_model(a)
        torque: Vector = pin.rnea(self.model, self._data, q, v, a)
        return torque[self._in_model]

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


def radius_from(placement: Any, geometry: Any) -> float:
    """Return how far a shape reaches at most from the origin that it is placed in [m]."""
    centre = placement.act(np.array(geometry.aabb_center))
    return float(np.linalg.norm(centre)) + float(geometry.aabb_radius)


def _link_problem(model: Any, name: str, path: Path) -> str:
    if model.existFrame(name, pin.FrameType.BODY):
        return ""
    known = [item.name for item in model.frames if item.type == pin.FrameType.BODY]
    return f"link {name!r} is not in {path.name}; {nearest(name, known)}"


def _joint_problems(
    model: Any, joints: Sequence[str], posture: Mapping[str, float], path: Path
) -> list[str]:
    movable = list(model.names)[1:]
    named = [*joints, *posture]
    problems = [
        f"joint {name!r} is not in {path.name}; {nearest(name, movable)}"
        for name in named
        if name not in movable
    ]
    for name in named:
        if name not in movable:
            continue
        joint = model.getJointId(name)
        at = model.idx_qs[joint]
        limits = (model.lowerPositionLimit[at], model.upperPositionLimit[at])
        if model.nqs[joint] != 1 or not -np.inf < limits[0] < limits[1] < np.inf:
            problems.append(
                f"joint {name!r} of {path} has no position limits; a planner needs them"
            )
    return problems + [f"joint {name!r} is in joints, too" for name in posture if name in joints]


def _still_posture(model: Any, posture: Mapping[str, float]) -> Vector:
    q: Vector = pin.neutral(model)
    for name, value in posture.items():
        q[model.idx_qs[model.getJointId(name)]] = value
    return q


def _use_hulls(geometry: Any) -> None:
    for item in geometry.geometryObjects:
        if hasattr(item.geometry, "buildConvexHull"):
            item.geometry.buildConvexHull(True, "Qt")
            item.geometry = item.geometry.convex


def _drop_harmless_pairs(model: Any, geometry: Any, still: Vector, srdf: Path | None) -> None:
    """Leave out the pairs that the SRDF names, or else neighbours and those that touch anyway."""
    if srdf is not None:
        try:
            pin.removeCollisionPairs(model, geometry, str(srdf))
        except ValueError as exc:
            raise WiringError(f"{srdf} is not an SRDF that Pinocchio can read: {exc}") from exc
        return
    data, touching = model.createData(), geometry.createData()
    pin.computeCollisions(model, data, geometry, touching, still, False)
    hits = [result.isCollision() for result in touching.collisionResults]

    def matters(place: int, first: int, second: int) -> bool:
        neighbours = first == model.parents[second] or second == model.parents[first]
        return not (hits[place] or neighbours)

    _keep_pairs(geometry, matters)


def drop_rigid_pairs(geometry: Any) -> None:
    """Leave out pairs of links that our joints do not move against one another."""
    _keep_pairs(geometry, lambda _place, first, second: first != second)


def _keep_pairs(geometry: Any, wanted: Callable[[int, int, int], bool]) -> None:
    """Keep the pairs that are wanted by their place and the numbers of their joints."""
    joints = [item.parentJoint for item in geometry.geometryObjects]
    # As numbers: what the list holds are references that change when a pair is removed.
    pairs = [(pair.first, pair.second) for pair in geometry.collisionPairs]
    geometry.removeAllCollisionPairs()
    for place, (first, second) in enumerate(pairs):
        if wanted(place, joints[first], joints[second]):
            geometry.addCollisionPair(pin.CollisionPair(first, second))
