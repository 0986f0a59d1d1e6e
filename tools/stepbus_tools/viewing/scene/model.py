"""A robot as it is drawn: what its links look like, and how joints move them."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from stepbus_models import Joint, Link, RobotDescription, Shape, is_file, read_robot, urdf_text
from stepbus_models import Pose as PoseDescription
from stepbus_schemas import WiringError
from stepbus_tools.viewing.scene.pose import Pose, about, from_rpy

from .meshes import GREY, PLACEHOLDER, Color, Mesh, Visual, mesh_file, primitive


@dataclass(frozen=True, kw_only=True)
class Model:
    """A robot as it is drawn."""

    robot: RobotDescription
    """As its file describes it."""
    links: Mapping[str, tuple[Visual, ...]]
    """What each link looks like."""
    joints: tuple[Joint, ...]
    """Parents first."""
    origins: Mapping[str, Pose]
    """Pose of each joint's child in its parent, at position 0."""
    rest: Mapping[str, float] = field(default_factory=dict)
    """Positions of joints that are not measured [rad or m]; default: the nearest to 0."""
    notes: tuple[str, ...] = ()
    """What cannot be shown as it is, a sentence each."""

    @property
    def root(self) -> str:
        """Return the name of the base link."""
        return self.robot.root

    @property
    def text(self) -> str:
        """Return the model as URDF."""
        return self.robot.text or urdf_text(self.robot)

    @property
    def has_joints(self) -> bool:
        """Return whether any of its joints has a position."""
        return any(joint.moves for joint in self.joints)

    def placed(self, joint: Joint, positions: Mapping[str, float]) -> Pose:
        """Return the pose of a joint's child in its parent. positions: by joint [rad or m]."""
        origin = self.origins[joint.name]
        if not joint.moves:
            return origin
        position = self._position(joint, positions)
        if joint.type == "prismatic":
            x, y, z = joint.axis
            return origin @ Pose((x * position, y * position, z * position))
        return origin @ Pose(wxyz=about(joint.axis, position))

    def _position(self, joint: Joint, positions: Mapping[str, float]) -> float:
        """Return where a joint is; an unmeasured one is where it rests or what it mimics."""
        if joint.name in positions:
            return positions[joint.name]
        leader = self.robot.joints.get(joint.mimic.joint) if joint.mimic else None
        if joint.mimic is None or leader is None or leader is joint:
            # A plant starts a joint at the position nearest to 0.
            start = 0.0 if joint.lower is None else max(0.0, joint.lower)
            start = start if joint.upper is None else min(start, joint.upper)
            return self.rest.get(joint.name, start)
        return joint.mimic.multiplier * self._position(leader, positions) + joint.mimic.offset

    def pose(self, link: str, positions: Mapping[str, float]) -> Pose:
        """Return the pose of a link in the root link."""
        pose = Pose()
        while (joint := self.robot.joint_above.get(link)) is not None:
            pose = self.placed(joint, positions) @ pose
            link = joint.parent
        return pose


def load_model(path: Path, rest: Mapping[str, float] = {}) -> Model:
    """Return the model of a URDF, xacro or MJCF.

    rest: joint → its position where it is not measured. Raises WiringError as `read_robot`.
    """
    robot = read_robot(path)
    notes = dict.fromkeys(robot.warnings if robot.format == "mjcf" else ())
    return Model(
        robot=robot,
        links={name: tuple(_visuals(link, notes)) for name, link in robot.links.items()},
        joints=tuple(_parents_first(robot)),
        origins={name: _pose(joint.pose) for name, joint in robot.joints.items()},
        rest=rest,
        notes=tuple(notes),
    )


def is_moved_by(joint: Joint, names: Collection[str]) -> bool:
    """Return whether a joint moves with one of some joints, of which it may be one."""
    leader = joint.mimic.joint if joint.mimic else joint.name
    return joint.moves and (joint.name in names or leader in names)


def _visuals(link: Link, notes: dict[str, None]) -> Iterator[Visual]:
    """Yield what a link looks like: its visuals, or its collision shapes."""
    for shape in link.visuals or link.collisions:
        for mesh in _meshes(link.name, shape, notes):
            yield Visual(mesh=mesh, pose=_pose(shape.pose), color=_rgb(shape.rgba))


def _meshes(link: str, shape: Shape, notes: dict[str, None]) -> Sequence[Mesh]:
    if shape.kind == "mesh":
        if not is_file(Path(shape.mesh)):
            notes[f"link {link} is a grey box: no mesh {shape.mesh}"] = None
            return [PLACEHOLDER]
        x, y, z = shape.size
        try:
            return mesh_file(Path(shape.mesh), (x, y, z))
        except (WiringError, ValueError, OSError) as exc:
            notes[f"link {link} is a grey box: {exc}"] = None
            return [PLACEHOLDER]
    mesh = primitive(shape.kind, shape.size)
    if mesh is None:
        notes[f"link {link}: <{shape.kind}> is not shown"] = None
    return [] if mesh is None else [mesh]


def _parents_first(robot: RobotDescription) -> Iterator[Joint]:
    below: dict[str, list[Joint]] = {}
    for joint in robot.joints.values():
        below.setdefault(joint.parent, []).append(joint)
    waiting = [robot.root]
    while waiting:
        for joint in below.get(waiting.pop(0), []):
            waiting.append(joint.child)
            yield joint


def _pose(pose: PoseDescription) -> Pose:
    return Pose(pose.xyz, from_rpy(pose.rpy))


def _rgb(rgba: Sequence[float] | None) -> Color:
    if rgba is None:
        return GREY
    red, green, blue, *_ = (round(255 * x) for x in rgba)
    return red, green, blue
