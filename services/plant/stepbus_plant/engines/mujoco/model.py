"""URDFs as MuJoCo has them: each link is a body, also behind a fixed joint.

MuJoCo's own parser fuses links, drops root links and the limits of velocities, and finds no meshes
of packages, so it is not used.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import mujoco
import numpy as np

from stepbus_plant.engine import BASE, JointInfo
from stepbus_plant.engines.differences import SHAPES, STIFFNESS, refused
from stepbus_plant.geometry import Array, Pose, quaternion, rotation
from stepbus_plant.models import mesh_path
from stepbus_schemas import Point, Quaternion, WiringError

SOLID, LOOKS = 3, 1
"""Groups of geoms: collision shapes, and what cameras see."""
_MOVES, _STANDS = 1, 2
"""Bits of a shape: whether its link can move; what stands does not collide with what stands."""
_FRICTION = {"lateral": 0.5, "rolling": 0.0, "spinning": 0.0}
"""What PyBullet takes where a model says nothing."""
_LEAST_FRICTION = 1e-5
_WHITE = (1.0, 1.0, 1.0, 1.0)
_CONTACT = (0.99, 0.999, 1e-3, 0.5, 2.0)
"""Impedance of contacts, stops and gears: as hard as the solver makes them."""
_KINDS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
}


@dataclass
class Body:
    """A loaded body. names: of its links, the root first. infos: its joints.

    parents: link → the one above it. inertials: link → pose of its centre of mass. is_fixed:
    whether its root stands. standing: links that cannot move. solid: links with a shape.
    root: its place when it was loaded. shift: the frame of a free root as the model has it, in that
    of the URDF [m]: at its centre of mass, which flies in a straight line, however it spins.
    frictions: lateral, spinning and rolling, by shape.
    """

    number: int
    names: list[str]
    infos: list[JointInfo]
    parents: dict[int, int]
    inertials: dict[int, Pose]
    masses: dict[int, float]
    root: Pose
    is_fixed: bool
    shift: Point = (0.0, 0.0, 0.0)
    frictions: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    standing: set[int] = field(default_factory=set)
    solid: set[int] = field(default_factory=set)

    def body_name(self, link: int) -> str:
        """Return the name of a link in the model."""
        return f"{self.number}/{self.names[link - BASE]}"


def hard(dt: float) -> dict[str, Any]:
    """Return the parameters of hard constraints; dt: length of a substep [s]."""
    return {"solref": [2 * dt, 2.0], "solimp": list(_CONTACT)}


class Builder:
    """Adds a URDF to a model. dt: length of a substep [s]."""

    def __init__(self, spec: Any, dt: float) -> None:
        self._spec, self._dt = spec, dt
        self._meshes: dict[tuple[str, Point, bool], str] = {}

    def add(
        self,
        number: int,
        urdf: Path,
        pose: Pose,
        friction: Mapping[str, float],
        *,
        is_fixed: bool,
        has_visuals: bool,
    ) -> Body:
        """Add a body; the other arguments are those of `Engine.load`."""
        root = ET.parse(urdf).getroot()  # noqa: S314  the file is the user's own
        links = {link.get("name", ""): link for link in root.findall("link")}
        top, order = _tree(urdf, root, links)
        names = [top, *(_child(joint) for joint in order)]
        indices = {name: n + BASE for n, name in enumerate(names)}
        body = Body(
            number=number,
            names=names,
            infos=[_info(n, joint) for n, joint in enumerate(order)],
            parents={n: indices[_parent(joint)] for n, joint in enumerate(order)},
            inertials={},
            masses={},
            root=pose,
            is_fixed=is_fixed,
        )
        palette = {
            material.get("name", ""): material.find("color") for material in root.iter("material")
        } if has_visuals else None  # fmt: skip
        place = _Place(urdf.parent, palette, friction)
        base = self._spec.worldbody.add_body(name=body.body_name(BASE))
        base.mocap = is_fixed
        if is_fixed:
            body.standing.add(BASE)
        else:
            base.add_freejoint(name=f"{number}/free")
            inertial = links[top].find("inertial")
            body.shift = (0.0, 0.0, 0.0) if inertial is None else _origin(inertial)[0]
        made = {BASE: base}
        self._fill(body, BASE, base, links[top], place)
        for n, joint in enumerate(order):
            above = body.parents[n]
            made[n] = link = made[above].add_body(name=body.body_name(n))
            at, turn = _origin(joint)
            link.pos, link.quat = _shifted(at, body, above), _wxyz(turn)
            if body.infos[n].type == "fixed":
                body.standing |= {n} if above in body.standing else set()
            else:
                self._add_joint(body, n, link)
            self._fill(body, n, link, links[names[n + 1]], place)
        return body

    def _add_joint(self, body: Body, n: int, link: Any) -> None:
        info = body.infos[n]
        slides = info.type == "prismatic"
        link.add_joint(
            name=f"{body.number}/{n}",
            type=mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE,
            axis=info.axis,
            solref_limit=[2 * self._dt, 1.0],
            solimp_limit=_CONTACT,
        )

    def _fill(self, body: Body, n: int, link: Any, element: ET.Element, place: "_Place") -> None:
        """Give a link its mass, shapes and looks."""
        try:
            self._weigh(body, n, link, element)
            self._add_shapes(body, n, link, element, place)
        except WiringError as exc:
            raise WiringError(f"link {element.get('name')!r}: {exc}") from exc

    def _add_shapes(
        self, body: Body, n: int, link: Any, element: ET.Element, place: "_Place"
    ) -> None:
        friction = place.friction_of(element)
        for k, collision in enumerate(element.findall("collision")):
            name = f"{body.number}/{n}/{k}"
            shape = self._shape(collision, place.folder, is_solid=True)
            if shape is None:
                continue
            shape["pos"] = _shifted(shape["pos"], body, n)
            stands = n in body.standing
            link.add_geom(
                **shape,
                name=name,
                group=SOLID,
                contype=_STANDS if stands else _MOVES,
                conaffinity=_MOVES if stands else _MOVES | _STANDS,
                condim=3 if not (friction[1] or friction[2]) else 6 if friction[2] else 4,
                **hard(self._dt),
            )
            body.frictions[name] = friction
            body.solid.add(n)
        for seen in element.findall("collision" if place.palette is None else "visual"):
            shape = self._shape(seen, place.folder, is_solid=False)
            if shape is not None:
                shape["pos"] = _shifted(shape["pos"], body, n)
                rgba = _colour(seen, place.palette or {})
                link.add_geom(**shape, group=LOOKS, contype=0, conaffinity=0, rgba=rgba)

    def _weigh(self, body: Body, n: int, link: Any, element: ET.Element) -> None:
        inertial = element.find("inertial")
        if inertial is None:
            raise WiringError("has no <inertial>")
        pose = _origin(inertial)
        mass = _attribute(_part(inertial, "mass"), "value", 1, "0")[0]
        body.inertials[n], body.masses[n] = pose, mass
        tensor = _part(inertial, "inertia")
        xx, yy, zz, xy, xz, yz = (
            _attribute(tensor, key, 1, "0")[0] for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        )
        link.explicitinertial = True
        link.mass, link.ipos = mass, _shifted(pose[0], body, n)
        if not (xy or xz or yz):
            link.inertia, link.iquat = [xx, yy, zz], _wxyz(pose[1])
            return
        turn = rotation(pose[1])
        full = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
        link.fullinertia = [full[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]

    def _shape(self, element: ET.Element, folder: Path, *, is_solid: bool) -> dict[str, Any] | None:
        """Return the arguments of a geom; None: it has no extent, or is solid and flat."""
        geometry = element.find("geometry/*")
        if geometry is None:
            return None
        at, turn = _origin(element)
        shape: dict[str, Any] = {"pos": at, "quat": _wxyz(turn)}
        if geometry.tag == "mesh":
            file = mesh_path(geometry.get("filename", ""), folder)
            scale = _vector(geometry, "scale", "1 1 1")
            mesh = self._mesh(file, scale, is_solid=is_solid)
            return (
                None
                if not mesh
                else {**shape, "type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": mesh}
            )
        if geometry.tag == "plane":
            return {**shape, "type": mujoco.mjtGeom.mjGEOM_PLANE, "size": [0, 0, 1]}
        if geometry.tag not in _KINDS:
            raise WiringError(f"<{geometry.tag}>: {refused(SHAPES)}")
        if geometry.tag == "box":
            size = [edge / 2 for edge in _attribute(geometry, "size", 3)]
        else:
            length = 0.0 if geometry.tag == "sphere" else _attribute(geometry, "length", 1)[0]
            size = [*_attribute(geometry, "radius", 1), length / 2, 0.0]
        return {**shape, "type": _KINDS[geometry.tag], "size": size}

    def _mesh(self, file: str, scale: Point, *, is_solid: bool) -> str:
        """Return the name of a mesh; empty: it has no extent, or is solid and has no volume."""
        key = (file, scale, is_solid)
        if key not in self._meshes:
            vertices, faces = _load_mesh(file)
            scaled = vertices * scale
            rank = np.linalg.matrix_rank(scaled - scaled[0], tol=1e-9)
            name = f"mesh {len(self._meshes)}" if rank >= (3 if is_solid else 2) else ""
            if name:
                mesh = self._spec.add_mesh(name=name)
                mesh.uservert, mesh.userface = scaled.ravel().tolist(), faces.ravel().tolist()
                kinds = mujoco.mjtMeshInertia
                hull, shell = kinds.mjMESH_INERTIA_CONVEX, kinds.mjMESH_INERTIA_SHELL
                mesh.inertia = hull if rank == 3 else shell
            self._meshes[key] = name
        return self._meshes[key]


@dataclass(frozen=True)
class _Place:
    """folder: of the URDF. palette: its colours; None: shapes are seen. friction: over its own."""

    folder: Path
    palette: Mapping[str, ET.Element | None] | None
    friction: Mapping[str, float]

    def friction_of(self, link: ET.Element) -> tuple[float, float, float]:
        """Return lateral, spinning and rolling friction of a link."""
        soft = [tag for tag in ("stiffness", "damping") if link.find(f"contact/{tag}") is not None]
        if soft:
            raise WiringError(refused(STIFFNESS))

        def value(kind: str) -> float:
            given = link.find(f"contact/{kind}_friction")
            own = _FRICTION[kind] if given is None else _attribute(given, "value", 1)[0]
            return self.friction.get(kind, own)

        return value("lateral"), value("spinning"), value("rolling")


def mixed(one: Array, other: Array) -> Array:
    """Return the friction of contacts, shape (n, 5), as PyBullet mixes it.

    one, other: lateral, spinning and rolling friction of both sides, shape (n, 3) each.
    """
    lateral = one[:, :1] * other[:, :1]
    rest = one[:, 1:] * other[:, :1] + other[:, 1:] * one[:, :1]
    both = np.hstack([lateral, lateral, rest[:, :1], rest[:, 1:], rest[:, 1:]])
    return np.maximum(both, _LEAST_FRICTION)


def _tree(
    urdf: Path, root: ET.Element, links: Mapping[str, ET.Element]
) -> tuple[str, list[ET.Element]]:
    """Return the root link, and all joints from there on, each before those behind it."""
    joints = root.findall("joint")
    behind: dict[str, list[ET.Element]] = {}
    for joint in joints:
        behind.setdefault(_parent(joint), []).append(joint)
    tops = [name for name in links if name not in {_child(joint) for joint in joints}]
    if len(tops) != 1:
        raise WiringError(f"{urdf}: has {len(tops)} root links, instead of one")

    def walk(name: str) -> Iterator[ET.Element]:
        for joint in behind.get(name, ()):
            yield joint
            yield from walk(_child(joint))

    order = list(walk(tops[0]))
    unknown = [name for joint in order if (name := _child(joint)) not in links]
    if unknown or len(order) != len(joints):
        raise WiringError(f"{urdf}: its joints do not make a tree of its links")
    return tops[0], order


def _info(n: int, joint: ET.Element) -> JointInfo:
    kind = joint.get("type", "")
    limit = joint.find("limit")
    names = () if limit is None else limit.attrib
    given = {key: _attribute(_part(joint, "limit"), key, 1)[0] for key in names}
    bounded = kind != "continuous" and {"lower", "upper"} & given.keys()
    axis = joint.find("axis")
    along = np.array(_vector(axis, "xyz", "1 0 0"))
    length = float(np.linalg.norm(along))
    x, y, z = (along / (length or 1.0)).tolist()
    return JointInfo(
        index=n,
        name=joint.get("name", ""),
        type="revolute" if kind == "continuous" else kind,
        lower=given.get("lower", 0.0) if bounded else 0.0,
        upper=given.get("upper", 0.0) if bounded else -1.0,
        effort=given.get("effort", 0.0),
        velocity=given.get("velocity", 0.0),
        link=_child(joint),
        axis=(x, y, z),
    )


@cache
def _load_mesh(file: str) -> tuple[Array, Any]:
    """Return vertices, shape (n, 3), and faces, shape (m, 3), of an STL, OBJ or DAE."""
    import coal  # noqa: PLC0415  only models with meshes need it

    try:
        loaded = coal.MeshLoader().load(file, np.ones(3))
    except (RuntimeError, ValueError, OSError) as exc:
        raise WiringError(f"{file}: cannot be read: {exc}") from exc
    faces = [
        [triangle[0], triangle[1], triangle[2]]
        for triangle in (loaded.tri_indices(n) for n in range(loaded.num_tris))
    ]
    return np.array(loaded.vertices(), dtype=float), np.array(faces, dtype=int)


def _colour(visual: ET.Element, palette: Mapping[str, ET.Element | None]) -> tuple[float, ...]:
    material = visual.find("material")
    own = None if material is None else material.find("color")
    if own is None and material is not None:
        own = palette.get(material.get("name", ""))
    return _WHITE if own is None else tuple(_attribute(own, "rgba", 4))


def _origin(element: ET.Element) -> Pose:
    origin = element.find("origin")
    return _vector(origin, "xyz", "0 0 0"), quaternion(_vector(origin, "rpy", "0 0 0"))


def _shifted(position: Point, body: Body, link: int) -> Point:
    """Return a position in the frame of a link as the model has it."""
    if link != BASE:
        return position
    x, y, z = (a - b for a, b in zip(position, body.shift, strict=True))
    return x, y, z


def _wxyz(orientation: Quaternion) -> list[float]:
    x, y, z, w = orientation
    return [w, x, y, z]


def _attribute(element: ET.Element, key: str, count: int, default: str = "") -> list[float]:
    """Return the numbers of an attribute."""
    text = element.get(key, default)
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        plural = "s" * (count > 1)
        raise WiringError(f"{key}={text!r} of <{element.tag}> is not {count} number{plural}")
    return numbers


def _vector(element: ET.Element | None, key: str, default: str) -> Point:
    x, y, z = _attribute(ET.Element("x") if element is None else element, key, 3, default)
    return x, y, z


def _part(element: ET.Element, tag: str) -> ET.Element:
    found = element.find(tag)
    return ET.Element(tag) if found is None else found


def _parent(joint: ET.Element) -> str:
    return _part(joint, "parent").get("link", "")


def _child(joint: ET.Element) -> str:
    return _part(joint, "child").get("link", "")
