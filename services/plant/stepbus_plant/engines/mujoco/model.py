"""Models as MuJoCo's own parsers read them, prepared to be part of a world.

An MJCF stays as it is. Of a URDF, a few attributes are written anew: those that MuJoCo's parser
does not read, or reads otherwise than the rest of stepbus.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import mujoco

from stepbus_plant.engine import BASE, JointInfo, Leader
from stepbus_plant.engines.differences import PLANES, PYBULLET_CONTACT, refused
from stepbus_plant.geometry import Pose
from stepbus_plant.meshes import is_text_stl, load_mesh
from stepbus_schemas import WiringError

BOTH, SOLID, SEEN, NEITHER = 2, 3, 1, 5
"""Groups of geoms: collision shapes that cameras see or do not see, what only cameras see."""
_SEEN_GROUPS = range(3)
"""Groups that MuJoCo's viewer shows from the start."""
LEAST_RANGE = 1e-9
"""MuJoCo has no joint that is locked by its stops [rad]."""
_ROOT = "world "
"""For a link `world`, which MuJoCo's parser takes for the world itself."""
_READS = (".stl", ".obj", ".msh")
_PARSER = {
    "fusestatic": "false",
    "discardvisual": "false",
    "strippath": "false",
    "balanceinertia": "true",
    "boundmass": "1e-9",
    "boundinertia": "1e-12",
}
"""Links behind fixed joints, and visuals, stay; what has no mass can move."""
_FRICTION = {"lateral": 1.0, "spinning": 0.005, "rolling": 0.0001}
"""MuJoCo's own."""
UNLIMITED = 1e12
"""What an actuator without limits can do [N or N·m]."""
_OPTIONS = ("integrator", "cone", "impratio", "noslip_iterations", "density", "viscosity", "wind")
_CONTACT_S = 0.01
"""Time constant of the contacts of a URDF [s]: half of MuJoCo's own, with which grippers lose what
they hold; with less, what slides is lifted and rattles."""
_GREY, _WHITE = [0.5, 0.5, 0.5, 1.0], [1.0, 1.0, 1.0, 1.0]
"""MuJoCo's default colour, and ours, as PyBullet's."""
_TYPES = {mujoco.mjtJoint.mjJNT_HINGE: "revolute", mujoco.mjtJoint.mjJNT_SLIDE: "prismatic"}
_ON_JOINTS = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)


@dataclass(kw_only=True)
class Body:
    """A loaded body.

    rows: names of a link and of the joint before it, if there is one, the root first. A link with
    several joints has a row for each. solid: names of links with a shape. infos: of all rows but
    the first. root: its place when it was loaded. is_fixed: whether its root stands. in_degrees:
    whether its file has angles in these. notes: what is left out.
    """

    number: int
    rows: list[tuple[str, str]]
    solid: set[str]
    infos: list[JointInfo]
    root: Pose
    is_fixed: bool
    is_urdf: bool
    in_degrees: bool
    notes: list[str]

    def body_name(self, index: int) -> str:
        """Return what MuJoCo calls a link."""
        return f"{self.number}/{self.rows[index - BASE][0]}"

    def joint_name(self, index: int) -> str:
        """Return what MuJoCo calls the joint before a link."""
        return f"{self.number}/{self.rows[index - BASE][1]}"

    def links(self) -> dict[str, int]:
        """Return each link by its name; what has several joints has the number of the last."""
        return {name.strip(): n + BASE for n, (name, _) in enumerate(self.rows)}


@dataclass(kw_only=True)
class Source:
    """A model that is read. joints: of a URDF, by their children; notes: see `Body`."""

    spec: Any
    is_urdf: bool
    joints: Mapping[str, ET.Element] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


# --- URDF ---------------------------------------------------------------------------------


def rigid(dt: float) -> list[float]:
    """Return the `solref` of what a URDF calls rigid: as stiff as MuJoCo lets a substep dt [s]."""
    return [2 * dt, 1.0]


def read_urdf(urdf: Path, friction: Mapping[str, float], *, has_visuals: bool, dt: float) -> Source:
    """Return a URDF as MuJoCo reads it.

    friction: over its own. dt: length of a substep [s].
    """
    root = ET.parse(urdf).getroot()  # noqa: S314  the file is the user's own
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", _PARSER)
    for element in root.iterfind(".//*[@link='world']"):
        element.set("link", _ROOT)
    for mesh in root.iter("mesh"):
        mesh.set("filename", str((urdf.parent / mesh.get("filename", "")).absolute()))
    links = root.findall("link")
    for link in links:
        link.set("name", _ROOT if link.get("name") == "world" else link.get("name", ""))
        if link.find("*/geometry/plane") is not None:
            raise WiringError(f"link {link.get('name')!r}: {refused(PLANES)}")
        for visual in link.findall("visual") if not has_visuals else ():
            link.remove(visual)
    joints = {part(joint, "child").get("link", ""): joint for joint in root.findall("joint")}
    for joint in joints.values():
        _simplify(joint)
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    _read_meshes(spec)
    for link in links:
        _finish(spec.body(link.get("name", "")), {**_contact(link), **friction}, dt)
    return Source(spec=spec, is_urdf=True, joints=joints)


def _finish(body: Any, friction: Mapping[str, float], dt: float) -> None:
    """Give a link what MuJoCo's parser does not: friction, and how rigid it is.

    What has no colour is white. What is half transparent has no depth in OpenGL: a camera sees it,
    or it does not.
    """
    _rub(body.geoms, friction)
    for geom in body.geoms:
        *colour, alpha = geom.rgba
        has_none = _is_solid(geom) or list(geom.rgba) == _GREY
        geom.rgba = _WHITE if has_none else [*colour, float(alpha > 0.0)]
        geom.solref = [_CONTACT_S, 1.0]
    for joint in body.joints:
        joint.solref_limit = rigid(dt)


def _simplify(joint: ET.Element) -> None:
    """Leave to the plant what it sets itself: damping, friction, followers.

    MuJoCo ignores stops at one place.
    """
    for tag in ("dynamics", "mimic"):
        if (found := joint.find(tag)) is not None:
            joint.remove(found)
    limit = part(joint, "limit")
    if (lower := limit.get("lower")) and lower == limit.get("upper"):
        limit.set("upper", repr(float(lower) + LEAST_RANGE))


def _contact(link: ET.Element) -> dict[str, float]:
    """Return the friction that a link gives itself."""
    for tag in PYBULLET_CONTACT:
        given = link.find(f"contact/{tag}")
        if given is not None and given.get("value") not in {"0", "0.0"}:
            text = refused(f"<{tag}> of a link's <contact>")
            raise WiringError(f"link {link.get('name')!r}: {text}")
    found = {kind: link.find(f"contact/{kind}_friction") for kind in _FRICTION}
    return {k: float(e.get("value", "")) for k, e in found.items() if e is not None}


def _read_meshes(spec: Any) -> None:
    """Read the meshes of a URDF that MuJoCo cannot; one that is flat has an area all the same."""
    for mesh in spec.meshes:
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        file = Path(mesh.file)
        if file.suffix.lower() not in _READS or is_text_stl(file):
            vertices, faces = load_mesh(mesh.file)
            mesh.uservert, mesh.userface = vertices.ravel().tolist(), faces.ravel().tolist()
            mesh.file = ""


def part(element: ET.Element, tag: str) -> ET.Element:
    """Return a child of an element; an empty one where there is none."""
    found = element.find(tag)
    return ET.Element(tag) if found is None else found


# --- MJCF ---------------------------------------------------------------------------------


def read_mjcf(mjcf: Path, friction: Mapping[str, float]) -> Source:
    """Return an MJCF as it is, but for what the world file has; friction: over its own."""
    spec = mujoco.MjSpec.from_file(str(mjcf.absolute()))
    for kind, elements in (("body", spec.bodies[1:]), ("joint", spec.joints)):
        for n, element in enumerate(elements):
            element.name = element.name or f"{kind}{n}"
    for key in list(spec.keys):
        spec.delete(key)
    _rub(spec.geoms, friction)
    return Source(spec=spec, is_urdf=False)


def _efforts(spec: Any) -> tuple[dict[str, float], list[str]]:
    """Remove the actuators that the plant's motors replace; return joint → what they can do.

    Muscles stay, without activation. Those that act on no joint have no command: the second value.
    """
    efforts: dict[str, float] = {}
    others = []
    for actuator in list(spec.actuators):
        if actuator.gaintype == mujoco.mjtGain.mjGAIN_MUSCLE:
            continue
        if actuator.trntype in _ON_JOINTS:
            force = _force(actuator) * abs(float(actuator.gear[0]))
            efforts[actuator.target] = efforts.get(actuator.target, 0.0) + force
        else:
            others.append(actuator.name or "without a name")
        spec.delete(actuator)
    return efforts, others


def _force(actuator: Any) -> float:
    """Return the largest force of an actuator; `UNLIMITED`: nothing limits it."""
    if any(actuator.forcerange):
        return float(max(map(abs, actuator.forcerange)))
    if actuator.biastype == mujoco.mjtBias.mjBIAS_NONE and any(actuator.ctrlrange):
        return float(abs(actuator.gainprm[0]) * max(map(abs, actuator.ctrlrange)))
    return UNLIMITED


# --- both ---------------------------------------------------------------------------------


def add(world: Any, source: Source, number: int, pose: Pose, *, is_fixed: bool) -> Body:
    """Add a model to a world; raises ValueError for what MuJoCo cannot compile."""
    spec = source.spec
    efforts, others = _efforts(spec)
    if others:
        source.notes.append(f"actuators that act on no joint are off: {', '.join(others)}")
    for body in spec.bodies:
        _group(body.geoms, hides_solids=source.is_urdf)
    in_world = _stand(source, is_fixed=is_fixed)
    model = spec.compile()
    made = Body(
        number=number,
        rows=list(_rows(model, in_world=in_world)),
        solid={body.name for body in spec.bodies if any(map(_is_solid, body.geoms))},
        infos=[],
        root=pose,
        is_fixed=is_fixed,
        is_urdf=source.is_urdf,
        in_degrees=bool(spec.compiler.degree),
        notes=source.notes,
    )
    leaders = _leaders(model)
    for index, (link, name) in enumerate(made.rows[1:]):
        joint = model.joint(name) if name else None
        info = _info(index, link, joint, source.joints.get(link), leaders.get(name))
        if joint is not None and not source.is_urdf:
            is_limited = model.jnt_actfrclimited[joint.id]
            own = abs(model.jnt_actfrcrange[joint.id]).max() if is_limited else UNLIMITED
            info = replace(info, effort=min(efforts.get(name, UNLIMITED), float(own)))
        made.infos.append(info)
    if not source.is_urdf and len(world.bodies) == 1:
        for option in _OPTIONS:
            setattr(world.option, option, getattr(spec.option, option))
    if in_world:
        frame = world.worldbody.add_body(name=made.body_name(BASE), mocap=True).add_frame()
    else:
        position, (x, y, z, w) = pose
        frame = world.worldbody.add_frame(pos=position, quat=(w, x, y, z))
    world.attach(spec, prefix=f"{number}/", frame=frame)
    return made


def _group(geoms: Iterable[Any], *, hides_solids: bool) -> None:
    """Sort the geoms of a body into groups; hides_solids: where it has others."""
    hides_solids &= not all(map(_is_solid, geoms))
    for geom in geoms:
        is_seen = geom.group in _SEEN_GROUPS and geom.rgba[3] > 0.0
        if _is_solid(geom):
            geom.group = BOTH if is_seen and not hides_solids else SOLID
        else:
            geom.group = SEEN if is_seen else NEITHER


def _is_solid(geom: Any) -> bool:
    return bool(geom.contype or geom.conaffinity)


def _rub(geoms: Iterable[Any], friction: Mapping[str, float]) -> None:
    """Give collision shapes a friction, which goes over that of shapes without a given one.

    What has none, such as a caster, slides on everything.
    """
    if not friction:
        return
    values = {**_FRICTION, **friction}
    slides = values["lateral"] == 0.0
    for geom in filter(_is_solid, geoms):
        geom.friction = [values["lateral"], values["spinning"], values["rolling"]]
        geom.condim = 6 if friction.get("rolling") else 4 if friction.get("spinning") else 3
        geom.condim, geom.priority = (1, 2) if slides else (geom.condim, 1)


def _stand(source: Source, *, is_fixed: bool) -> bool:
    """Fix the root of a model, or let it fly; return whether its root is its world.

    So it is where that has several bodies, or one that moves along or about its axes.
    """
    spec = source.spec
    roots = list(spec.worldbody.bodies)
    joints = [joint for root in roots for joint in root.joints]
    is_free = any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in joints)
    if len(roots) != 1 or (joints and not is_free):
        if not is_fixed:
            raise WiringError("its root is its world; set `fixed_base: true`")
        return True
    (root,) = roots
    if spec.worldbody.geoms:
        source.notes.append("geoms of its <worldbody> are left out")
    for element in (*spec.worldbody.geoms, *(joints if is_fixed else ())):
        spec.delete(element)
    root.pos, root.quat = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    root.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    if not (is_fixed or is_free):
        root.add_freejoint()
    root.mocap = is_fixed
    return False


def _rows(model: Any, *, in_world: bool) -> Iterator[tuple[str, str]]:
    """Yield the names of the root and nothing, then of each body and each of its joints."""
    yield model.body(0 if in_world else 1).name, ""
    for n in range(1 if in_world else 2, model.nbody):
        first = int(model.body_jntadr[n])
        joints = [model.joint(first + k).name for k in range(model.body_jntnum[n])]
        yield from ((model.body(n).name, joint) for joint in joints or [""])


def _info(
    index: int, link: str, joint: Any, described: ET.Element | None, leader: Leader | None
) -> JointInfo:
    """Return a joint as `Engine.joints` has it; joint: None: fixed. described: in a URDF."""
    limit = ET.Element("limit") if described is None else part(described, "limit")
    name = f"{link}_fixed" if joint is None else joint.name
    is_limited = joint is not None and bool(joint.limited[0])
    return JointInfo(
        index=index,
        name=name if described is None else described.get("name", ""),
        type="fixed" if joint is None else _TYPES.get(mujoco.mjtJoint(joint.type[0]), ""),
        lower=float(joint.range[0]) if is_limited else 0.0,
        upper=float(joint.range[1]) if is_limited else -1.0,
        effort=float(limit.get("effort", 0.0)),
        velocity=float(limit.get("velocity", 0.0)),
        link=link.strip(),
        axis=(0.0, 0.0, 1.0) if joint is None else tuple(joint.axis.tolist()),
        damping=0.0 if joint is None else float(joint.damping[0]),
        leader=leader,
    )


def _leaders(model: Any) -> dict[str, Leader]:
    """Return joint → the one that it follows, by the linear couplings of a model."""
    found: dict[str, Leader] = {}
    for row in range(model.neq):
        one, other = int(model.eq_obj1id[row]), int(model.eq_obj2id[row])
        is_joint = model.eq_type[row] == mujoco.mjtEq.mjEQ_JOINT and other >= 0
        if is_joint and model.eq_active0[row] and not model.eq_data[row, 2:5].any():
            here, there = (float(model.qpos0[model.jnt_qposadr[n]]) for n in (one, other))
            constant, slope = model.eq_data[row, :2].tolist()
            offset = here + constant - slope * there
            found[model.joint(one).name] = Leader(model.joint(other).name, slope, offset)
    return found
