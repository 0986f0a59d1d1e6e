"""Models of robots in MJCF, MuJoCo's XML, as URDF: the tree of bodies below one in the world.

Specification: mujoco.readthedocs.io. MuJoCo itself resolves defaults, includes and orientations. A
link has the frame of its body, and positions of joints are the same: 0 is where MJCF has it. What
URDF has no words for is in the table of `mjcf_kinds`.
"""

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

from stepbus_schemas import WiringError

from .mjcf_kinds import SHAPES, take_stock
from .mjcf_model import Mjcf
from .model_pose import IDENTITY, Pose, pose_of_wxyz, shift, text_of, turn_about
from .urdf_check import LEFT_OUT

_UNLIMITED = 1e12
_TINY = {"mass": 1e-9, "moment": 1e-12}
"""Of a link that MuJoCo has no body for, or a body without a mass [kg, kg·m²]."""
_MOMENTS = ("ixx", "iyy", "izz")


def mjcf_to_urdf(root: ET.Element, path: Path) -> str:
    """Return a model in MJCF as the text of a URDF.

    root: of the file. Raises ExtraMissing without the package `mujoco`, and WiringError for what
    MuJoCo does not compile, or no URDF says.
    """
    mjcf = Mjcf(path, root)
    left_out = take_stock(mjcf)
    robot = _Writer(mjcf).robot()
    notes = [f"MuJoCo warns: {warning}" for warning in mjcf.warnings]
    for note in (left_out, *notes) if left_out else notes:
        ET.SubElement(robot, LEFT_OUT).text = note
    # PyBullet cuts lines after 1023 characters.
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode")


class _Mimic(NamedTuple):
    """A joint that a joint follows: q = multiplier · q of the leader + offset."""

    leader: int
    multiplier: float
    offset: float


class _Writer:
    """Writes a model. An element that has no name in MJCF gets one that is free."""

    def __init__(self, mjcf: Mjcf) -> None:
        self._mjcf, self._model = mjcf, mjcf.model
        self._links = set(mjcf.bodies)
        self._joints = set(mjcf.joints)
        self._mimics = _mimics(mjcf)
        self._robot = ET.Element("robot", {"name": mjcf.name or "model"})

    def robot(self) -> ET.Element:
        """Return the robot."""
        roots = self._mjcf.roots()
        if len(roots) != 1:
            names = "".join(f" {self._mjcf.bodies[body]!r}" for body in roots)
            count = f"{len(roots)} bodies{':' if roots else ''}{names}"
            text = f"has {count} in its <worldbody>; give each body its own file"
            raise WiringError(f"{self._mjcf.path}: {text}, with exactly one body")
        (top,) = roots
        if self._mjcf.joints_of(top):
            # What moves along or about an axis of the world needs it as its root.
            self._add_tiny(self._mjcf.bodies[0])
            self._add_chain(top)
        for body in range(1, self._model.nbody):
            self._add_link(body)
            if body != top:
                self._add_chain(body)
        return self._robot

    # --- joints ---------------------------------------------------------------------------

    def _add_chain(self, body: int) -> None:
        """Add the joints from the parent of a body to the body.

        Between them, and where the last one is not at the origin of the body, are links of hardly
        any mass.
        """
        model, name = self._model, self._mjcf.bodies[body]
        parent = self._mjcf.bodies[model.body_parentid[body]]
        at = pose_of_wxyz(model.body_pos[body].tolist(), model.body_quat[body].tolist())
        anchor, joints = [0.0, 0.0, 0.0], self._mjcf.joints_of(body)
        for joint in joints:
            here = self._anchor(joint, anchor)
            at = at @ shift([a - b for a, b in zip(here, anchor, strict=True)])
            is_body = joint == joints[-1] and not any(here)
            child = name if is_body else self._add_tiny(f"{self._mjcf.joints[joint]}_link")
            self._add_joint(joint, parent, child, at @ self._back(joint))
            parent, at, anchor = child, IDENTITY, here
        if parent != name:
            fixed = _free(f"{name}_fixed", self._joints)
            self._join(fixed, "fixed", parent, name, at @ shift([-value for value in anchor]))

    def _anchor(self, joint: int, before: list[float]) -> list[float]:
        """Return where a joint is in its body; a slide is everywhere, so where the last one is."""
        if self._mjcf.joint_kind(joint) == "slide":
            return before
        position: list[float] = self._model.jnt_pos[joint].tolist()
        return position

    def _back(self, joint: int) -> Pose:
        """Return what a joint does from the place that MJCF has the body in to position 0."""
        start = float(self._model.qpos0[self._model.jnt_qposadr[joint]])
        axis = self._model.jnt_axis[joint].tolist()
        if not start:
            return IDENTITY
        if self._mjcf.joint_kind(joint) == "slide":
            return shift([-start * value for value in axis])
        return turn_about(axis, -start)

    def _add_joint(self, joint: int, parent: str, child: str, origin: Pose) -> None:
        model = self._model
        is_limited, is_slide = model.jnt_limited[joint], self._mjcf.joint_kind(joint) == "slide"
        kind = "prismatic" if is_slide else "revolute" if is_limited else "continuous"
        element = self._join(self._mjcf.joints[joint], kind, parent, child, origin)
        ET.SubElement(element, "axis", {"xyz": text_of(model.jnt_axis[joint].tolist())})
        limit = {"effort": repr(_effort(self._mjcf, joint)), "velocity": repr(_UNLIMITED)}
        if is_limited:
            lower, upper = model.jnt_range[joint].tolist()
            limit |= {"lower": repr(lower), "upper": repr(upper)}
        ET.SubElement(element, "limit", limit)
        freedom = model.jnt_dofadr[joint]
        damping, friction = model.dof_damping[freedom], model.dof_frictionloss[freedom]
        if damping or friction:
            row = {"damping": repr(float(damping)), "friction": repr(float(friction))}
            ET.SubElement(element, "dynamics", row)
        if joint in self._mimics:
            mimic = self._mimics[joint]
            row = {"multiplier": repr(mimic.multiplier), "offset": repr(mimic.offset)}
            ET.SubElement(element, "mimic", {"joint": self._mjcf.joints[mimic.leader], **row})

    def _join(self, name: str, kind: str, parent: str, child: str, origin: Pose) -> ET.Element:
        element = ET.SubElement(self._robot, "joint", {"name": name, "type": kind})
        element.append(origin.origin())
        ET.SubElement(element, "parent", {"link": parent})
        ET.SubElement(element, "child", {"link": child})
        return element

    # --- links ----------------------------------------------------------------------------

    def _add_tiny(self, wanted: str) -> str:
        """Add a link that MuJoCo has no body for; return its name."""
        name = wanted if wanted == self._mjcf.bodies[0] else _free(wanted, self._links)
        link = ET.SubElement(self._robot, "link", {"name": name})
        link.append(_inertial(IDENTITY, _TINY["mass"], [_TINY["moment"]] * 3))
        return name

    def _add_link(self, body: int) -> None:
        model, mjcf = self._model, self._mjcf
        link = ET.SubElement(self._robot, "link", {"name": mjcf.bodies[body]})
        at = pose_of_wxyz(model.body_ipos[body].tolist(), model.body_iquat[body].tolist())
        mass = max(float(model.body_mass[body]), _TINY["mass"])
        moments = [max(value, _TINY["moment"]) for value in model.body_inertia[body].tolist()]
        link.append(_inertial(at, mass, moments))
        geoms = [geom for geom in mjcf.geoms_of(body) if mjcf.geom_kind(geom) in SHAPES]
        for geom in filter(mjcf.is_seen, geoms):
            self._add_shape(link, "visual", geom)
        for geom in filter(mjcf.is_solid, geoms):
            self._add_shape(link, "collision", geom)
        self._add_contact(link, [geom for geom in geoms if mjcf.is_solid(geom)])

    def _add_shape(self, link: ET.Element, tag: str, geom: int) -> None:
        name = self._mjcf.geoms[geom]
        row = ET.SubElement(link, tag, {"name": name})
        row.append(self._mjcf.geom_pose(geom).origin())
        geometry = ET.SubElement(row, "geometry")
        ET.SubElement(geometry, self._mjcf.geom_kind(geom), self._size(geom))
        if tag == "visual":
            material = ET.SubElement(row, "material", {"name": f"{name}_colour"})
            ET.SubElement(material, "color", {"rgba": text_of(self._mjcf.colour(geom))})

    def _size(self, geom: int) -> dict[str, str]:
        """Return the attributes of a geom's shape."""
        kind = self._mjcf.geom_kind(geom)
        size = self._model.geom_size[geom].tolist()
        if kind == "mesh":
            folder = self._mjcf.path.parent
            file = os.path.relpath(self._mjcf.mesh_file(geom) or folder, folder)
            return {
                "filename": Path(file).as_posix(),
                "scale": text_of(self._mjcf.scale(geom)),
            }
        if kind == "box":
            return {"size": text_of([2 * half for half in size])}
        radius = {"radius": repr(size[0])}
        return radius if kind == "sphere" else {**radius, "length": repr(2 * size[1])}

    def _add_contact(self, link: ET.Element, solid: list[int]) -> None:
        """Add the friction of a link: sliding, and the others where MuJoCo computes with them."""
        if not solid:
            return
        contact = ET.SubElement(link, "contact")
        for tag, column, dimensions in (("lateral", 0, 3), ("spinning", 1, 4), ("rolling", 2, 6)):
            rough = [geom for geom in solid if self._model.geom_condim[geom] >= dimensions]
            values = [float(self._model.geom_friction[geom, column]) for geom in rough]
            if values or tag == "lateral":
                ET.SubElement(contact, f"{tag}_friction", {"value": repr(max(values, default=0.0))})


def _inertial(at: Pose, mass: float, moments: list[float]) -> ET.Element:
    """Return the inertial of a link; moments: along the axes of its pose [kg·m²]."""
    row = ET.Element("inertial")
    row.append(at.origin())
    ET.SubElement(row, "mass", {"value": repr(mass)})
    products = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    values = {key: repr(value) for key, value in zip(_MOMENTS, moments, strict=True)}
    ET.SubElement(row, "inertia", values | products)
    return row


def _effort(mjcf: Mjcf, joint: int) -> float:
    """Return what all actuators of a joint can do together [N·m or N]."""
    model, efforts = mjcf.model, []
    for row in range(model.nactuator):
        actuator = model.actuator(row)
        kind = mjcf.kind("mjtTrn", int(actuator.trntype[0]))
        if kind in {"joint", "jointinparent"} and int(actuator.trnid.flat[0]) == joint:
            efforts.append(_force(mjcf, row) * abs(float(actuator.gear.flat[0])))
    effort = sum(efforts) if efforts else math.inf
    if model.jnt_actfrclimited[joint]:
        effort = min(effort, float(abs(model.jnt_actfrcrange[joint]).max()))
    return effort if math.isfinite(effort) else _UNLIMITED


def _force(mjcf: Mjcf, row: int) -> float:
    """Return the largest force of an actuator; infinite: nothing limits it."""
    actuator = mjcf.model.actuator(row)
    if actuator.forcelimited.flat[0]:
        return float(abs(actuator.forcerange).max())
    is_motor = (
        mjcf.kind("mjtGain", int(actuator.gaintype[0])) == "fixed"
        and mjcf.kind("mjtBias", int(actuator.biastype[0])) == "none"
    )
    if is_motor and actuator.ctrllimited.flat[0]:
        return float(abs(actuator.gainprm.flat[0]) * abs(actuator.ctrlrange).max())
    return math.inf


def _mimics(mjcf: Mjcf) -> dict[int, _Mimic]:
    """Return the joints that follow one that follows none itself."""
    model, direct = mjcf.model, dict[int, _Mimic]()
    for row in range(model.neq):
        if model.eq_active0[row]:
            joint, leader = int(model.eq_obj1id[row]), int(model.eq_obj2id[row])
            own, other = (float(model.qpos0[model.jnt_qposadr[n]]) for n in (joint, leader))
            constant, slope = model.eq_data[row, :2].tolist()
            direct[joint] = _Mimic(leader, slope, own + constant - slope * other)
    return {joint: _resolved(mjcf, direct, joint) for joint in direct}


def _resolved(mjcf: Mjcf, direct: Mapping[int, _Mimic], joint: int) -> _Mimic:
    """Return the last joint that a joint follows, by way of others."""
    mimic = direct[joint]
    for _ in direct:
        if mimic.leader not in direct:
            return mimic
        above = direct[mimic.leader]
        offset = mimic.multiplier * above.offset + mimic.offset
        mimic = _Mimic(above.leader, mimic.multiplier * above.multiplier, offset)
    raise WiringError(
        f"{mjcf.path}: joint {mjcf.joints[joint]!r} follows itself through its couplings"
    )


def _free(wanted: str, names: set[str]) -> str:
    """Return a name that is not among `names`, and add it."""
    name = wanted
    while name in names:
        name += "_"
    names.add(name)
    return name
