"""A robot's model as it is drawn: its links, and how joints move them."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.etree import ElementTree as ET

from stepbus_participant import Mimic, mimics, package_path, parse_urdf, read_urdf_text
from stepbus_schemas import WiringError
from stepbus_tools.viewing.scene.pose import Pose, Vector, about, from_rpy, unit

from .meshes import GREY, PLACEHOLDER, Color, Mesh, Visual, mesh_file, primitive

_SIZES = {
    "box": ("size",),
    "capsule": ("radius", "length"),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
}
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

    notes: what cannot be shown as it is, a sentence each. text: as it was read, XML.
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
    """Return the model of a URDF, SDF or xacro.

    rest: joint → its position where it is not measured. Raises WiringError as `read_urdf_text`.
    """
    text = read_urdf_text(path)
    return replace(_Reader(path, parse_urdf(text), rest).read(), text=text)


class _Reader:
    def __init__(self, path: Path, root: ET.Element, rest: Mapping[str, float]) -> None:
        self._path = path
        self._root = root
        self._rest = rest
        self._notes: dict[str, None] = {}
        self._palette = {
            material.get("name", ""): _rgb(color)
            for material in root.iter("material")
            if (color := material.find("color")) is not None
        }

    def read(self) -> Model:
        joints = {joint.child: joint for joint in self._joints()}
        links = {
            link.get("name", ""): tuple(self._visuals(link)) for link in self._root.findall("link")
        }
        root = next((name for name in links if name not in joints), next(iter(links), ""))
        return Model(
            root=root,
            links=links,
            joints=tuple(_parents_first(root, joints)),
            notes=tuple(self._notes),
            above=joints,
        )

    def _joints(self) -> Iterator[Joint]:
        followers = mimics(self._root)  # type: ignore[arg-type]  # what parse_urdf returned
        for element in self._root.findall("joint"):
            name = element.get("name", "")
            yield Joint(
                name=name,
                type=element.get("type", "fixed"),
                parent=_link(element, "parent"),
                child=_link(element, "child"),
                origin=_origin(element),
                axis=unit(_numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0))),
                rest=self._rest.get(name, _rest(element)),
                mimic=followers.get(name),
            )

    def _visuals(self, link: ET.Element) -> Iterator[Visual]:
        """Yield what a link looks like: its visuals, or its collision shapes."""
        for element in link.findall("visual") or link.findall("collision"):
            geometry = element.find("geometry/*")
            if geometry is not None:
                pose, color = _origin(element), self._color(element) or GREY
                for mesh in self._meshes(link.get("name", ""), geometry):
                    yield Visual(mesh=mesh, pose=pose, color=color)

    def _meshes(self, link: str, geometry: ET.Element) -> Sequence[Mesh]:
        if geometry.tag == "mesh":
            x, y, z = _numbers(geometry, "scale", (1.0, 1.0, 1.0))
            try:
                return mesh_file(self._file(geometry.get("filename", "")), (x, y, z))
            except (WiringError, ValueError, OSError) as exc:
                self._notes[f"link {link} is a grey box: {exc}"] = None
                return [PLACEHOLDER]
        keys = _SIZES.get(geometry.tag, ())
        size = tuple(x for key in keys for x in _numbers(geometry, key, ()))
        mesh = primitive(geometry.tag, size)
        if mesh is None:
            self._notes[f"link {link}: <{geometry.tag}> is not shown"] = None
        return [] if mesh is None else [mesh]

    def _file(self, name: str) -> Path:
        folder = self._path.parent
        is_packaged = name.startswith("package://")
        path = package_path(name, folder) if is_packaged else folder / name.removeprefix("file://")
        if not path.is_file():
            raise ValueError(f"no mesh {name}")
        return path

    def _color(self, element: ET.Element) -> Color | None:
        material = element.find("material")
        if material is None:
            return None
        own = material.find("color")
        return self._palette.get(material.get("name", "")) if own is None else _rgb(own)


def _parents_first(root: str, joints: Mapping[str, Joint]) -> Iterator[Joint]:
    below: dict[str, list[Joint]] = {}
    for joint in joints.values():
        below.setdefault(joint.parent, []).append(joint)
    waiting, seen = [root], set()
    while waiting:
        for joint in below.get(waiting.pop(0), []):
            if joint.child not in seen:
                seen.add(joint.child)
                waiting.append(joint.child)
                yield joint


def _link(joint: ET.Element, side: str) -> str:
    element = joint.find(side)
    return "" if element is None else element.get("link", "")


def _origin(element: ET.Element) -> Pose:
    origin = element.find("origin")
    x, y, z = _numbers(origin, "xyz", (0.0, 0.0, 0.0))
    return Pose((x, y, z), from_rpy(_numbers(origin, "rpy", (0.0, 0.0, 0.0))))


def _rest(joint: ET.Element) -> float:
    """Return the position nearest to 0 within the limits, where a plant starts a joint too."""
    limit = joint.find("limit")
    if limit is None or joint.get("type") == "continuous":
        return 0.0
    (lower,) = _numbers(limit, "lower", (0.0,))
    (upper,) = _numbers(limit, "upper", (0.0,))
    return min(max(0.0, lower), upper)


def _rgb(color: ET.Element) -> Color:
    red, green, blue, *_ = (round(255 * x) for x in _numbers(color, "rgba", (0.7, 0.7, 0.7, 1.0)))
    return red, green, blue


def _numbers(element: ET.Element | None, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
    """Return the numbers of an attribute; the default where it is absent or is none."""
    text = None if element is None else element.get(key)
    if text is None:
        return default
    try:
        numbers = tuple(float(word) for word in text.split())
    except ValueError:
        return default
    is_whole = len(numbers) == len(default) or not default
    return numbers if is_whole and all(map(math.isfinite, numbers)) else default
