"""What is in a URDF: its tree, joints, shapes and colours."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from stepbus_plant.engine import JointInfo
from stepbus_plant.engines.differences import PYBULLET_CONTACT, refused
from stepbus_plant.geometry import Pose, quaternion
from stepbus_schemas import Point, Quaternion, WiringError

_FRICTION = {"lateral": 0.5, "rolling": 0.0, "spinning": 0.0}
"""What PyBullet takes where a model says nothing."""
_WHITE = (1.0, 1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Place:
    """folder: of the URDF. palette: its colours; None: shapes are seen. friction: over its own."""

    folder: Path
    palette: Mapping[str, ET.Element] | None
    friction: Mapping[str, float]

    def friction_of(self, link: ET.Element) -> tuple[float, float, float]:
        """Return lateral, spinning and rolling friction of a link."""
        for tag in PYBULLET_CONTACT:
            given = link.find(f"contact/{tag}")
            if given is not None and given.get("value") not in {"0", "0.0"}:
                raise WiringError(refused(f"<{tag}> of a link's <contact>"))

        def value(kind: str) -> float:
            given = link.find(f"contact/{kind}_friction")
            own = _FRICTION[kind] if given is None else attribute(given, "value", 1)[0]
            return self.friction.get(kind, own)

        return value("lateral"), value("spinning"), value("rolling")


def tree(
    urdf: Path, root: ET.Element, links: Mapping[str, ET.Element]
) -> tuple[str, list[ET.Element]]:
    """Return the root link, and all joints from there on, each before those behind it."""
    joints = root.findall("joint")
    behind: dict[str, list[ET.Element]] = {}
    for joint in joints:
        behind.setdefault(parent_of(joint), []).append(joint)
    tops = [name for name in links if name not in {child_of(joint) for joint in joints}]
    if len(tops) != 1:
        raise WiringError(f"{urdf}: has {len(tops)} root links, not one")

    order: list[ET.Element] = []
    waiting = behind.get(tops[0], [])[::-1]
    while waiting and len(order) <= len(joints):
        order.append(waiting.pop())
        waiting += behind.get(child_of(order[-1]), [])[::-1]
    unknown = [name for joint in order if (name := child_of(joint)) not in links]
    if unknown or len(order) != len(joints):
        raise WiringError(f"{urdf}: its joints and links do not form a tree")
    return tops[0], order


def joint_info(n: int, joint: ET.Element) -> JointInfo:
    """Return a joint as `Engine.joints` has it; n: its number."""
    kind = joint.get("type", "")
    limit = joint.find("limit")
    names = {"lower", "upper", "effort", "velocity"} & set(() if limit is None else limit.attrib)
    given = {key: attribute(part(joint, "limit"), key, 1)[0] for key in names}
    bounded = kind != "continuous" and {"lower", "upper"} & given.keys()
    axis = joint.find("axis")
    along = np.array(vector(axis, "xyz", "1 0 0"))
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
        link=child_of(joint),
        axis=(x, y, z),
    )


def colour(visual: ET.Element, palette: Mapping[str, ET.Element]) -> tuple[float, ...]:
    """Return red, green, blue and alpha of a visual, 0 to 1."""
    material = visual.find("material")
    own = None if material is None else material.find("color")
    if own is None and material is not None:
        own = palette.get(material.get("name", ""))
    if own is None:
        return _WHITE
    red, green, blue, alpha = attribute(own, "rgba", 4)
    # What is half transparent has no depth in OpenGL: a camera sees it, or it does not.
    return red, green, blue, float(alpha > 0.0)


def origin(element: ET.Element) -> Pose:
    """Return the pose of an element's <origin>."""
    found = element.find("origin")
    return vector(found, "xyz", "0 0 0"), quaternion(vector(found, "rpy", "0 0 0"))


def wxyz(orientation: Quaternion) -> list[float]:
    """Return an orientation as MuJoCo has it."""
    x, y, z, w = orientation
    return [w, x, y, z]


def attribute(element: ET.Element, key: str, count: int, default: str = "") -> list[float]:
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


def vector(element: ET.Element | None, key: str, default: str) -> Point:
    """Return the three numbers of an attribute."""
    x, y, z = attribute(ET.Element("x") if element is None else element, key, 3, default)
    return x, y, z


def part(element: ET.Element, tag: str) -> ET.Element:
    """Return a child of an element; an empty one where there is none."""
    found = element.find(tag)
    return ET.Element(tag) if found is None else found


def parent_of(joint: ET.Element) -> str:
    """Return the link before a joint."""
    return part(joint, "parent").get("link", "")


def child_of(joint: ET.Element) -> str:
    """Return the link behind a joint."""
    return part(joint, "child").get("link", "")
