"""The robot that the planner moves: its model, its shapes, and how far it reaches."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from stepbus_kinematics import RobotModel, Vector, collision_geometry, radius_from
from stepbus_participant import suggest
from stepbus_schemas import Description, Poses, WiringError, parse_shapes
from stepbus_store.planner.outline import Outline
from stepbus_store.poses import check_poses


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


_GEOMETRIES: Mapping[str, Callable[..., Any]] = {
    "box": coal.Box,
    "capsule": coal.Capsule,
    "cylinder": coal.Cylinder,
    "sphere": coal.Sphere,
}


@dataclass(frozen=True, kw_only=True)
class Solid:
    """A convex shape, and its placement in its link."""

    geometry: Any
    placement: Any


@dataclass(frozen=True, kw_only=True)
class Link:
    """A link of the world; index: in Poses; shapes: empty if it has none."""

    name: str
    index: int
    shapes: tuple[Solid, ...]


def column(outline: Outline, height: float) -> Link:
    """Return an upright box on the floor around an outline, in the frame of that."""
    low, high = outline.corners.min(axis=0), outline.corners.max(axis=0)
    shape = coal.Box(*(high - low).tolist(), height)
    shape.computeLocalAABB()
    place = pin.SE3(np.eye(3), np.array([*(low + high) / 2, height / 2]))
    return Link(name=outline.link, index=-1, shapes=(Solid(geometry=shape, placement=place),))


_MOVED = 2e-3
"""Displacement between two messages from which something moves [m]."""


class Obstacles:
    """All links that are not the robot's.

    described: of the input Poses/1: `names`, and `details` with `shape` and `body` per link, see
    docs/reference/world.md. frame: a link of the robot; placements are relative to it. prefix: what
    the names of the robot's links begin with there. unknown: names of links with shapes that the
    planner cannot check, such as meshes and planes.
    Raises WiringError for missing details and invalid shapes.
    """

    def __init__(self, port: str, described: Description, frame: str, prefix: str = "") -> None:
        names, details = described.names, described.details
        problems = [
            f"input {port!r} does not describe the {key} of its links"
            for key in ("shape", "body")
            if len(details.get(key, ())) != len(names)
        ]
        if frame not in names:
            problems.append(f"input {port!r} has no link {frame!r}{suggest(frame, names)}")
        if problems:
            raise WiringError("\n".join(problems))
        self._port, self._prefix = port, prefix
        self._indices = {name: index for index, name in enumerate(names)}
        self._frame = names.index(frame)
        own = details["body"][self._frame]
        self.unknown: list[str] = []
        self.links = {
            name: Link(name=name, index=index, shapes=self._read_shapes(name, text))
            for index, (name, text, body) in enumerate(
                zip(names, details["shape"], details["body"], strict=True)
            )
            if body != own
        }

    def _read_shapes(self, name: str, text: str) -> tuple[Solid, ...]:
        try:
            shapes = parse_shapes(text)
        except ValueError as exc:
            raise WiringError(f"input {self._port!r}: link {name!r}: {exc}") from exc
        solids = []
        for shape in shapes:
            if shape.type not in _GEOMETRIES:
                continue
            geometry = _GEOMETRIES[shape.type](*shape.sizes)
            geometry.computeLocalAABB()
            placement = _placement([*shape.position, *shape.orientation])
            solids.append(Solid(geometry=geometry, placement=placement))
        if len(solids) < len(shapes):
            self.unknown.append(name)
        return tuple(solids)

    def check(self, poses: Poses) -> None:
        """Raise RunError for a wrong number of poses, and for an invalid one."""
        check_poses(self._port, list(self._indices), poses)

    def frame_in_world(self, poses: Poses) -> Any:
        """Return the pose of `frame`, as `pinocchio.SE3`."""
        return _pose(poses, self._frame)

    def placements(self, poses: Poses, frame: Any = None) -> dict[str, Any]:
        """Return the pose of each link in `frame`, or in another frame, as `pinocchio.SE3`."""
        base = (self.frame_in_world(poses) if frame is None else frame).inverse()
        return {name: base * _pose(poses, link.index) for name, link in self.links.items()}

    def own(self, poses: Poses, name: str) -> Any:
        """Return the pose of a link of the robot in `frame`; None: Poses does not have it."""
        index = self._indices.get(self._prefix + name)
        return None if index is None else self.frame_in_world(poses).inverse() * _pose(poses, index)

    def reach(self, poses: Poses, name: str) -> float:
        """Return how far a link of the robot is from the axis of `frame` [m]; 0: it has no pose."""
        pose = self.own(poses, name)
        return 0.0 if pose is None else math.hypot(*pose.translation[:2])

    def moving(self, before: Poses, now: Poses) -> frozenset[str]:
        """Return the links that have moved from one message to the next."""
        return frozenset(
            name
            for name, link in self.links.items()
            if math.dist(before.position[link.index], now.position[link.index]) > _MOVED
        )


def _pose(poses: Poses, index: int) -> Any:
    return _placement([*poses.position[index], *poses.orientation[index]])


def _placement(numbers: list[float]) -> Any:
    """Return the SE3 of x, y, z and a quaternion x, y, z, w of about length 1."""
    rotation = pin.Quaternion(np.array(numbers[3:]))
    rotation.normalize()
    return pin.SE3(rotation, np.array(numbers[:3]))
