"""URDFs as MuJoCo has them: each link is a body, also behind a fixed joint.

MuJoCo's own parser fuses links, drops root links and the limits of velocities, and finds no meshes
of packages, so it is not used.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import mujoco
import numpy as np

from stepbus_plant.engine import BASE, JointInfo
from stepbus_plant.engines.differences import PLANES, refused
from stepbus_plant.engines.mujoco.urdf import (
    Place,
    attribute,
    child_of,
    colour,
    joint_info,
    origin,
    parent_of,
    part,
    tree,
    vector,
    wxyz,
)
from stepbus_plant.geometry import Array, Pose, rotation
from stepbus_plant.meshes import convex_hull, load_mesh
from stepbus_schemas import Point, WiringError

SOLID, LOOKS = 3, 1
"""Groups of geoms: collision shapes, and what cameras see."""
_MOVES, _STANDS = 1, 2
"""Bits of a shape: whether its link can move; what stands does not collide with what stands."""
_LEAST_FRICTION = 1e-5
_CONTACT = (0.99, 0.999, 1e-3, 0.5, 2.0)
"""Impedance of contacts, stops and gears: as hard as the solver makes them."""
_TINY_MASS, _TINY_INERTIA = 1e-9, 1e-12
"""Less than that, MuJoCo takes for nothing [kg, kg·m²]."""
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
        top, order = tree(urdf, root, links)
        names = [top, *(child_of(joint) for joint in order)]
        indices = {name: n + BASE for n, name in enumerate(names)}
        body = Body(
            number=number,
            names=names,
            infos=[joint_info(n, joint) for n, joint in enumerate(order)],
            parents={n: indices[parent_of(joint)] for n, joint in enumerate(order)},
            inertials={},
            masses={},
            root=pose,
            is_fixed=is_fixed,
        )
        colours = ((m.get("name", ""), m.find("color")) for m in root.iter("material"))
        # A material is defined once, and used by its name elsewhere.
        palette = {name: colour for name, colour in colours if colour is not None}
        place = Place(urdf.parent, palette if has_visuals else None, friction)
        base = self._spec.worldbody.add_body(name=body.body_name(BASE))
        base.mocap = is_fixed
        if is_fixed:
            body.standing.add(BASE)
        else:
            base.add_freejoint(name=f"{number}/free")
            inertial = links[top].find("inertial")
            body.shift = (0.0, 0.0, 0.0) if inertial is None else origin(inertial)[0]
        made = {BASE: base}
        self._fill(body, BASE, base, links[top], place)
        for n, joint in enumerate(order):
            above = body.parents[n]
            made[n] = link = made[above].add_body(name=body.body_name(n))
            at, turn = origin(joint)
            link.pos, link.quat = _shifted(at, body, above), wxyz(turn)
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

    def _fill(self, body: Body, n: int, link: Any, element: ET.Element, place: Place) -> None:
        """Give a link its mass, shapes and looks."""
        try:
            self._weigh(body, n, link, element)
            self._add_shapes(body, n, link, element, place)
        except WiringError as exc:
            raise WiringError(f"link {element.get('name')!r}: {exc}") from exc

    def _add_shapes(self, body: Body, n: int, link: Any, element: ET.Element, place: Place) -> None:
        friction = place.friction_of(element)
        for k, collision in enumerate(element.findall("collision")):
            name = f"{body.number}/{n}/{k}"
            shape = self._shape(collision, place.folder, is_solid=True)
            if shape is None:
                continue
            if shape["type"] == mujoco.mjtGeom.mjGEOM_PLANE and n not in body.standing:
                raise WiringError(refused(PLANES))
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
        visuals = [] if place.palette is None else element.findall("visual")
        for seen in visuals or element.findall("collision"):
            shape = self._shape(seen, place.folder, is_solid=False)
            if shape is not None:
                shape["pos"] = _shifted(shape["pos"], body, n)
                rgba = colour(seen, place.palette or {})
                link.add_geom(**shape, group=LOOKS, contype=0, conaffinity=0, rgba=rgba)

    def _weigh(self, body: Body, n: int, link: Any, element: ET.Element) -> None:
        inertial = element.find("inertial")
        if inertial is None:
            raise WiringError("has no <inertial>")
        pose = origin(inertial)
        mass = attribute(part(inertial, "mass"), "value", 1, "0")[0]
        body.inertials[n], body.masses[n] = pose, mass
        tensor = part(inertial, "inertia")
        xx, yy, zz, xy, xz, yz = (
            attribute(tensor, key, 1, "0")[0] for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        )
        link.explicitinertial = True
        moves = n not in body.standing
        mass, least = (max(mass, _TINY_MASS), _TINY_INERTIA) if moves else (mass, 0.0)
        xx, yy, zz = (max(moment, least) for moment in (xx, yy, zz))
        link.mass, link.ipos = mass, _shifted(pose[0], body, n)
        if not (xy or xz or yz):
            link.inertia, link.iquat = [xx, yy, zz], wxyz(pose[1])
            return
        turn = rotation(pose[1])
        full = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
        link.fullinertia = [full[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]

    def _shape(self, element: ET.Element, folder: Path, *, is_solid: bool) -> dict[str, Any] | None:
        """Return the arguments of a geom; None: it has no extent, or is solid and flat."""
        geometry = element.find("geometry/*")
        if geometry is None:
            return None
        at, turn = origin(element)
        shape: dict[str, Any] = {"pos": at, "quat": wxyz(turn)}
        if geometry.tag == "mesh":
            file = geometry.get("filename", "")
            words = len(geometry.get("scale", "1").split())
            factors = attribute(geometry, "scale", 1 if words == 1 else 3, "1")
            x, y, z = factors * 3 if words == 1 else factors
            mesh = self._mesh(file, (x, y, z), is_solid=is_solid)
            return (
                None
                if not mesh
                else {**shape, "type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": mesh}
            )
        if geometry.tag == "plane":
            shape["quat"] = _towards(shape["quat"], vector(geometry, "normal", "0 0 1"))
            return {**shape, "type": mujoco.mjtGeom.mjGEOM_PLANE, "size": [0, 0, 1]}
        if geometry.tag not in _KINDS:
            raise WiringError(
                f"<{geometry.tag}> is not supported; use one of {', '.join(_KINDS)}, mesh or plane"
            )
        if geometry.tag == "box":
            size = [edge / 2 for edge in _extent(geometry, "size", 3)]
        else:
            length = 0.0 if geometry.tag == "sphere" else _extent(geometry, "length", 1)[0]
            size = [*_extent(geometry, "radius", 1), length / 2, 0.0]
        return {**shape, "type": _KINDS[geometry.tag], "size": size}

    def _mesh(self, file: str, scale: Point, *, is_solid: bool) -> str:
        """Return the name of a mesh; empty: it has no extent, or is solid and has no volume."""
        key = (file, scale, is_solid)
        if key not in self._meshes:
            vertices, faces = load_mesh(file)
            scaled = vertices * scale
            # A mirrored one would be inside out.
            faces = faces[:, ::-1] if np.prod(scale) < 0.0 else faces
            rank = np.linalg.matrix_rank(scaled - scaled[0], tol=1e-9)
            name = f"mesh {len(self._meshes)}" if rank >= (3 if is_solid else 2) else ""
            if name and is_solid:
                # MuJoCo's contacts are with the hull; so are its rays then, as in PyBullet.
                scaled, faces = convex_hull(scaled)
            if name:
                mesh = self._spec.add_mesh(name=name)
                mesh.uservert, mesh.userface = scaled.ravel().tolist(), faces.ravel().tolist()
                kinds = mujoco.mjtMeshInertia
                hull, shell = kinds.mjMESH_INERTIA_CONVEX, kinds.mjMESH_INERTIA_SHELL
                mesh.inertia = hull if rank == 3 else shell
            self._meshes[key] = name
        return self._meshes[key]


def mixed(one: Array, other: Array) -> Array:
    """Return the friction of contacts, shape (n, 5), as PyBullet mixes it.

    one, other: lateral, spinning and rolling friction of both sides, shape (n, 3) each.
    """
    lateral = one[:, :1] * other[:, :1]
    rest = one[:, 1:] * other[:, :1] + other[:, 1:] * one[:, :1]
    both = np.hstack([lateral, lateral, rest[:, :1], rest[:, 1:], rest[:, 1:]])
    return np.maximum(both, _LEAST_FRICTION)


def _extent(geometry: ET.Element, key: str, count: int) -> list[float]:
    """Return lengths of a shape, which has none without them [m]."""
    lengths = attribute(geometry, key, count)
    if min(lengths) <= 0.0:
        raise WiringError(f"{key}={geometry.get(key)!r} of <{geometry.tag}> must be above 0")
    return lengths


def _towards(orientation: list[float], normal: Point) -> list[float]:
    """Return an orientation w, x, y, z, turned so that its z axis is a normal."""
    if not any(normal):
        raise WiringError("normal='0 0 0' of <plane> has no direction")
    turn, turned = np.zeros(4), np.zeros(4)
    mujoco.mju_quatZ2Vec(turn, np.array(normal))
    mujoco.mju_mulQuat(turned, np.array(orientation), turn)
    return [float(part) for part in turned]


def _shifted(position: Point, body: Body, link: int) -> Point:
    """Return a position in the frame of a link as the model has it."""
    if link != BASE:
        return position
    x, y, z = (a - b for a, b in zip(position, body.shift, strict=True))
    return x, y, z
