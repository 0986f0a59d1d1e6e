"""Writes a robot as URDF for programs that read nothing else."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from .description import Inertial, Joint, Pose, RobotDescription, Shape

_UNLIMITED = 1e12
_SIZES = {
    "box": "size",
    "sphere": "radius",
    "cylinder": "radius length",
    "capsule": "radius length",
    "mesh": "scale",
    "plane": "normal",
}


def urdf_text(
    robot: RobotDescription, *, for_pinocchio: bool = False, meshes: Mapping[str, Path] = {}
) -> str:
    """Return a robot as the text of a URDF, with every number to its last bit.

    for_pinocchio: without planes and what is seen, with continuous joints as revolute ones, whose
    position is one number, and with capsules as its parser of XML wants them: cylinders that are
    marked. meshes: files to name instead of those of the robot. Ball
    joints, which URDF lacks, are fixed.
    """
    root = ET.Element("robot", {"name": robot.name})
    for link in robot.links.values():
        element = ET.SubElement(root, "link", {"name": link.name})
        _add_inertial(element, link.inertial)
        for visual in () if for_pinocchio else link.visuals:
            _add_shape(element, "visual", visual, meshes)
        for shape in link.collisions:
            if for_pinocchio and shape.kind == "plane":
                continue
            _add_shape(element, "collision", shape, meshes)
        if link.contact:
            contact = ET.SubElement(element, "contact")
            for tag, value in link.contact.items():
                ET.SubElement(contact, tag, {"value": repr(value)})
        if for_pinocchio:
            _mark_capsules(element)
    for joint in robot.joints.values():
        _add_joint(root, joint, one_number=for_pinocchio)
    # PyBullet cuts lines after 1023 characters.
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def _add_inertial(link: ET.Element, inertial: Inertial | None) -> None:
    if inertial is None:
        return
    element = ET.SubElement(link, "inertial")
    _add_pose(element, inertial.pose)
    ET.SubElement(element, "mass", {"value": repr(inertial.mass)})
    keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    moments = {key: repr(value) for key, value in zip(keys, inertial.moments, strict=True)}
    ET.SubElement(element, "inertia", moments)


def _add_shape(link: ET.Element, tag: str, shape: Shape, meshes: Mapping[str, Path]) -> None:
    element = ET.SubElement(link, tag, {"concave": "yes"} if shape.is_concave else {})
    _add_pose(element, shape.pose)
    keys = _SIZES[shape.kind].split()
    sizes = [shape.size] if len(keys) == 1 else [(value,) for value in shape.size]
    attributes = {key: _text(size) for key, size in zip(keys, sizes, strict=True)}
    if shape.kind == "mesh":
        attributes["filename"] = str(meshes.get(shape.mesh, shape.mesh))
    ET.SubElement(ET.SubElement(element, "geometry"), shape.kind, attributes)
    if shape.rgba is not None and tag == "visual":
        rgba = _text(shape.rgba)
        # Readers look up a colour by the name of its material, too.
        material = ET.SubElement(element, "material", {"name": rgba})
        ET.SubElement(material, "color", {"rgba": rgba})


def _mark_capsules(link: ET.Element) -> None:
    """Turn capsules into cylinders, and name those that Pinocchio is to take as capsules."""
    marks = ET.Element("collision_checking")
    for number, collision in enumerate(link.iterfind("collision")):
        for capsule in collision.iterfind("geometry/capsule"):
            capsule.tag = "cylinder"
            collision.set("name", f"capsule {number}")
            ET.SubElement(marks, "capsule", {"name": f"capsule {number}"})
    if len(marks):
        link.append(marks)


def _add_joint(root: ET.Element, joint: Joint, *, one_number: bool) -> None:
    kind = joint.type if joint.moves else "fixed"
    if one_number and kind == "continuous":
        kind = "revolute"
    element = ET.SubElement(root, "joint", {"name": joint.name, "type": kind})
    _add_pose(element, joint.pose)
    ET.SubElement(element, "parent", {"link": joint.parent})
    ET.SubElement(element, "child", {"link": joint.child})
    if not joint.moves:
        return
    ET.SubElement(element, "axis", {"xyz": _text(joint.axis)})
    stops = {"lower": joint.lower, "upper": joint.upper}
    limit = {key: repr(value) for key, value in stops.items() if value is not None}
    motor = {"effort": joint.effort, "velocity": joint.velocity}
    if limit or kind != "continuous" or any(value is not None for value in motor.values()):
        limit |= {key: repr(_UNLIMITED if v is None else v) for key, v in motor.items()}
        ET.SubElement(element, "limit", limit)
    if joint.damping or joint.friction:
        row = {"damping": repr(joint.damping), "friction": repr(joint.friction)}
        ET.SubElement(element, "dynamics", row)
    if (mimic := joint.mimic) is not None:
        row = {"multiplier": repr(mimic.multiplier), "offset": repr(mimic.offset)}
        ET.SubElement(element, "mimic", {"joint": mimic.joint, **row})


def _add_pose(element: ET.Element, pose: Pose) -> None:
    if any(pose.xyz) or any(pose.rpy):
        ET.SubElement(element, "origin", {"xyz": _text(pose.xyz), "rpy": _text(pose.rpy)})


def _text(values: Sequence[float]) -> str:
    return " ".join(map(repr, values))
