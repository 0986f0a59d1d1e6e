"""Models as MuJoCo's own parsers read them, prepared to be part of a world.

An MJCF stays as it is. Of a URDF, a few attributes are written anew: those that MuJoCo's parser
does not read, or reads otherwise than the rest of stepbus.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco

from stepbus_models import RobotDescription, urdf_text
from stepbus_models.mjcf import read_spec
from stepbus_plant.engine import BASE, Loading
from stepbus_plant.geometry import Pose
from stepbus_plant.meshes import is_text_stl, load_mesh
from stepbus_schemas import WiringError

BOTH, SOLID, SEEN, NEITHER = 2, 3, 1, 5
"""Groups of geoms: visible and invisible collision shapes, visuals, and geoms of no use."""
_SEEN_GROUPS = range(3)
"""Groups that MuJoCo's viewer shows from the start."""
_ROOT = "world "
"""Name of a link `world`, which MuJoCo's parser takes for the world itself."""
_WORLD = re.compile('(<link name|link)="world"')
_READS = (".stl", ".obj", ".msh")
_PARSER = """<mujoco><compiler fusestatic="false" discardvisual="false" strippath="false"
balanceinertia="true" boundmass="1e-9" boundinertia="1e-12"/></mujoco>"""
"""Links behind fixed joints and visuals are kept; links without mass can move."""
_FRICTION = {"lateral": 1.0, "spinning": 0.005, "rolling": 0.0001}
"""MuJoCo's own."""
_OPTIONS = ("integrator", "cone", "impratio", "noslip_iterations", "density", "viscosity", "wind")
_CONTACT_S = 0.01
"""Time constant of the contacts of a URDF [s]: half of MuJoCo's own, with which grippers lose what
they hold; with less, what slides is lifted and rattles."""
_GREY, _WHITE = [0.5, 0.5, 0.5, 1.0], [1.0, 1.0, 1.0, 1.0]
"""MuJoCo's default colour, and ours, as PyBullet's."""
_ON_JOINTS = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)


@dataclass(kw_only=True)
class Body:
    """A loaded body.

    rows: (link, joint before it) by MuJoCo's names, the root and "" first; a link with several
    joints has a row for each. solid: names of links with a collision shape. is_fixed: whether the
    root is fixed. notes: sentences about parts of the model that are not used.
    """

    number: int
    rows: list[tuple[str, str]]
    solid: set[str]
    is_fixed: bool
    notes: list[str]

    def body_name(self, index: int) -> str:
        """Return MuJoCo's name of the link of a joint's number."""
        return f"{self.number}/{self.rows[index - BASE][0]}"

    def joint_name(self, index: int) -> str:
        """Return MuJoCo's name of a joint."""
        return f"{self.number}/{self.rows[index - BASE][1]}"


def _read(robot: RobotDescription, options: Loading, dt: float) -> Any:
    """Return the `MjSpec` of a robot."""
    if robot.format == "urdf":
        shown = robot.links.values()
        links = {k.name: k if options.has_visuals else replace(k, visuals=()) for k in shown}
        return _read_urdf(replace(robot, links=links), options.friction, dt)
    spec = read_spec(robot.path)
    for key in list(spec.keys):
        spec.delete(key)
    _rub(spec.geoms, options.friction)
    return spec


# --- URDF ---------------------------------------------------------------------------------


def rigid(dt: float) -> list[float]:
    """Return the stiffest `solref` that is stable with substeps of dt [s]: URDF stops are rigid."""
    return [2 * dt, 1.0]


def _read_urdf(robot: RobotDescription, friction: Mapping[str, float], dt: float) -> Any:
    """Return the `MjSpec` of a URDF."""
    for link in robot.links.values():
        if any(shape.kind == "plane" for shape in (*link.visuals, *link.collisions)):
            text = "engine mujoco does not support a `<plane>` in a URDF"
            raise WiringError(f"link {link.name!r}: {text}; use engine pybullet, or remove it")
    # The plant sets friction, and couples followers to their leaders.
    joints = {n: replace(j, friction=0.0, mimic=None) for n, j in robot.joints.items()}
    text = urdf_text(replace(robot, joints=joints)).replace("</robot>", f"{_PARSER}</robot>")
    spec = mujoco.MjSpec.from_string(_WORLD.sub(rf'\1="{_ROOT}"', text))
    _read_meshes(spec)
    for link in robot.links.values():
        given = {tag.removesuffix("_friction"): value for tag, value in link.contact.items()}
        own = {kind: value for kind, value in given.items() if kind in _FRICTION}
        name = _ROOT if link.name == "world" else link.name
        _finish(spec.body(name), {**own, **friction}, dt)
    # Its mistakes are those of this robot.
    spec.compile()
    return spec


def _finish(body: Any, friction: Mapping[str, float], dt: float) -> None:
    """Set friction, stiffness and colours of a link, which MuJoCo's parser does not.

    Shapes without a colour are white. Half transparent ones are opaque, as OpenGL gives them no
    depth.
    """
    _rub(body.geoms, friction)
    for geom in body.geoms:
        *colour, alpha = geom.rgba
        has_none = _is_solid(geom) or list(geom.rgba) == _GREY
        geom.rgba = _WHITE if has_none else [*colour, float(alpha > 0.0)]
        geom.solref = [_CONTACT_S, 1.0]
    for joint in body.joints:
        joint.solref_limit = rigid(dt)


def _read_meshes(spec: Any) -> None:
    """Read the meshes that MuJoCo cannot read; inertias of shells allow flat meshes."""
    for mesh in spec.meshes:
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        file = Path(mesh.file)
        if file.suffix.lower() not in _READS or is_text_stl(file):
            vertices, faces = load_mesh(mesh.file)
            mesh.uservert, mesh.userface = vertices.ravel().tolist(), faces.ravel().tolist()
            mesh.file = ""


# --- MJCF ---------------------------------------------------------------------------------


def _silence(spec: Any) -> list[str]:
    """Remove the actuators but muscles; return the names of those that act on no joint.

    The plant's motors replace those on joints; muscles stay without activation.
    """
    others = []
    for actuator in list(spec.actuators):
        if actuator.gaintype != mujoco.mjtGain.mjGAIN_MUSCLE:
            others += [] if actuator.trntype in _ON_JOINTS else [actuator.name or "without a name"]
            spec.delete(actuator)
    return others


# --- both ---------------------------------------------------------------------------------


def add(world: Any, robot: RobotDescription, number: int, pose: Pose, options: Loading) -> Body:
    """Add a robot to the `MjSpec` of a world; return its body.

    Raises WiringError for a model that MuJoCo does not support, ValueError or mujoco.FatalError
    for a model that it does not read.
    """
    spec, notes = _read(robot, options, world.option.timestep), []
    is_urdf = robot.format == "urdf"
    if others := _silence(spec):
        notes.append(f"actuators that act on no joint are off: {', '.join(others)}")
    given = {tag for link in robot.links.values() for tag, value in link.contact.items() if value}
    if unread := sorted(given - {f"{kind}_friction" for kind in _FRICTION}):
        notes.append(f"engine mujoco does not use {', '.join(unread)} of a <contact>")
    for body in spec.bodies:
        _group(body.geoms, hides_solids=is_urdf)
    in_world = _stand(spec, notes, is_fixed=options.is_fixed)
    made = Body(
        number=number,
        rows=list(_rows(robot, spec.bodies[0 if in_world else 1 :])),
        solid={body.name for body in spec.bodies if any(map(_is_solid, body.geoms))},
        is_fixed=options.is_fixed,
        notes=notes,
    )
    if not is_urdf and len(world.bodies) == 1:
        for option in _OPTIONS:
            setattr(world.option, option, getattr(spec.option, option))
    # Otherwise MuJoCo warns of whatever differs.
    spec.option, spec.visual, spec.stat = world.option, world.visual, world.stat
    position, (x, y, z, w) = pose
    frame = world.worldbody.add_frame(pos=position, quat=(w, x, y, z))
    if in_world:
        base = world.worldbody.add_body(
            name=made.body_name(BASE), mocap=True, pos=position, quat=(w, x, y, z)
        )
        # Free joints are allowed in the world only.
        free = (joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.joints)
        frame = frame if any(free) else base.add_frame()
    world.attach(spec, prefix=f"{number}/", frame=frame)
    return made


def _group(geoms: Iterable[Any], *, hides_solids: bool) -> None:
    """Sort the geoms of a body into groups; hides_solids: cameras see its visuals instead."""
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
    """Set the friction of collision shapes; a given one has priority over MuJoCo's default.

    A coefficient of 0, such as a caster's, has priority over all others.
    """
    if not friction:
        return
    values = {**_FRICTION, **friction}
    slides = values["lateral"] == 0.0
    for geom in filter(_is_solid, geoms):
        geom.friction = [values["lateral"], values["spinning"], values["rolling"]]
        geom.condim = 6 if friction.get("rolling") else 4 if friction.get("spinning") else 3
        geom.condim, geom.priority = (1, 2) if slides else (geom.condim, 1)


def _stand(spec: Any, notes: list[str], *, is_fixed: bool) -> bool:
    """Fix the root of a model, or free it; return whether the root is the model's world.

    It is where the world has several bodies, or a body on other joints than a free one.
    """
    roots = list(spec.worldbody.bodies)
    joints = [joint for root in roots for joint in root.joints]
    is_free = any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in joints)
    if len(roots) != 1 or (joints and not is_free):
        if not is_fixed:
            raise WiringError("its root is its world; set `fixed_base: true`")
        return True
    (root,) = roots
    if spec.worldbody.geoms:
        notes.append("geoms of its <worldbody> are left out")
    for element in (*spec.worldbody.geoms, *(joints if is_fixed else ())):
        spec.delete(element)
    root.pos, root.quat = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    root.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    if not (is_fixed or is_free):
        root.add_freejoint()
    root.mocap = is_fixed
    return False


def _rows(robot: RobotDescription, bodies: Sequence[Any]) -> Iterator[tuple[str, str]]:
    """Yield the rows of a `Body`.

    A description has links between the joints of a body; MuJoCo has none.
    """
    links = {body.name.strip(): body.name for body in bodies}
    yield bodies[0].name, ""
    for link, name in list(links.items())[1:]:
        chain = [robot.joint_above[link]]
        while chain[-1].parent not in links:
            chain.append(robot.joint_above[chain[-1].parent])
        yield from ((name, joint.name) for joint in reversed(chain))
