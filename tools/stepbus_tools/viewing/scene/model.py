"""A robot's model as it is drawn: its links, and how joints move them."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from stepbus_models import Joint as JointDescription
from stepbus_models import Link, Mimic, Shape, is_file, read_robot, urdf_text
from stepbus_models import Pose as PoseDescription
from stepbus_schemas import WiringError
from stepbus_tools.viewing.scene.pose import Pose, Vector, about, from_rpy

from .meshes import GREY, PLACEHOLDER, Color, Mesh, Visual, mesh_file, primitive

_TURNING = ("revolute", "continuous")
_SLIDING = ("prismatic",)


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A joint of a model. origin: of its child in its parent, at position 0. rest: [rad or m].

    mimic: what it follows; None: nothing.
    """

    name: str
    type: str
    parent: str
    child: str
    origin: Pose
    axis: Vector
    rest: float = 0.0
    mimic: Mimic | None = None

    @property
    def moves(self) -> bool:
        """Return whether it has a position."""
        return self.type in _TURNING or self.type in _SLIDING

    def is_moved_by(self, names: Collection[str]) -> bool:
        """Return whether it moves with one of some joints, of which it may be one."""
        leader = self.mimic.joint if self.mimic else self.name
        return self.moves and (self.name in names or leader in names)

    def at(self, position: float) -> Pose:
        """Return the pose of its child in its parent. position: [rad or m]."""
        if self.type in _SLIDING:
            x, y, z = self.axis
            return self.origin @ Pose((x * position, y * position, z * position))
        if self.type in _TURNING:
            return self.origin @ Pose(wxyz=about(self.axis, position))
        return self.origin


@dataclass(frozen=True, kw_only=True)
class Model:
    """A model. links: name → what it looks like. joints: parents first. root: its first link.

    notes: what cannot be shown as it is, a sentence each. text: URDF, as it was read.
    """

    root: str
    links: Mapping[str, tuple[Visual, ...]]
    joints: tuple[Joint, ...]
    notes: tuple[str, ...] = ()
    above: Mapping[str, Joint] = field(default_factory=dict)
    text: str = ""

    @property
    def has_joints(self) -> bool:
        """Return whether any of its joints has a position."""
        return any(joint.moves for joint in self.joints)

    def position(self, joint: Joint, positions: Mapping[str, float]) -> float:
        """Return where a joint is; an unmeasured one is where it rests or what it mimics."""
        if joint.name in positions:
            return positions[joint.name]
        mimic = joint.mimic
        leaders = (one for one in self.joints if mimic is not None and one.name == mimic.joint)
        leader = next(leaders, joint)
        if mimic is None or leader is joint:
            return joint.rest
        return mimic.multiplier * self.position(leader, positions) + mimic.offset

    def pose(self, link: str, positions: Mapping[str, float]) -> Pose:
        """Return the pose of a link in the root link."""
        pose = Pose()
        while (joint := self.above.get(link)) is not None:
            pose = joint.at(self.position(joint, positions)) @ pose
            link = joint.parent
        return pose


def load_model(path: Path, rest: Mapping[str, float] = {}) -> Model:
    """Return the model of a URDF, xacro or MJCF.

    rest: joint → its position where it is not measured. Raises WiringError as `read_robot`.
    """
    robot = read_robot(path)
    notes = dict.fromkeys(robot.warnings if robot.format == "mjcf" else ())
    joints = [_joint(joint, rest) for joint in robot.joints.values()]
    above = {joint.child: joint for joint in joints}
    return Model(
        root=robot.root,
        links={name: tuple(_visuals(link, notes)) for name, link in robot.links.items()},
        joints=tuple(_parents_first(robot.root, above)),
        notes=tuple(notes),
        above=above,
        text=robot.text or urdf_text(robot),
    )


def _joint(joint: JointDescription, rest: Mapping[str, float]) -> Joint:
    """Return a joint; without a measurement, a plant starts it at the position nearest to 0."""
    start = 0.0 if joint.lower is None else max(0.0, joint.lower)
    start = start if joint.upper is None else min(start, joint.upper)
    return Joint(
        name=joint.name,
        type=joint.type,
        parent=joint.parent,
        child=joint.child,
        origin=_pose(joint.pose),
        axis=joint.axis,
        rest=rest.get(joint.name, start),
        mimic=joint.mimic,
    )


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


def _parents_first(root: str, joints: Mapping[str, Joint]) -> Iterator[Joint]:
    below: dict[str, list[Joint]] = {}
    for joint in joints.values():
        below.setdefault(joint.parent, []).append(joint)
    waiting = [root]
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
