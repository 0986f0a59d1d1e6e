"""Models of robots in SDF, as URDF: one model of links and joints, without what only Gazebo uses.

Specification: sdformat.org. A child link's frame becomes that of its joint, and the root's that of
the model, as URDF has it. The model's own <pose> is left out: the world says where a body is.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from stepbus_schemas import WiringError

from .model_pose import IDENTITY, Pose, pose_of_rpy, text_of
from .urdf_check import Element, twins

_TYPES = ("revolute", "continuous", "prismatic", "fixed")
_REFUSED = ("include", "model", "frame")
_UNUSED = {
    "static": "true",
    "link/gravity": "false",
    "link/kinematic": "true",
    "joint/axis/dynamics/spring_stiffness": "",
}
"""What changes how a model moves, and no URDF says → its value; empty: any but 0."""
_UNLIMITED = 1e15
_VERSION = re.compile(r"[0-9]+(\.[0-9]+)*")
_INERTIA = {"ixx": 1.0, "iyy": 1.0, "izz": 1.0, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}
"""What SDF takes where a moment of inertia is missing [kg·m²]."""


def sdf_to_urdf(root: Element, path: Path) -> str:
    """Return a model in SDF as the text of a URDF.

    Raises WiringError with line and reason for what no URDF says, or this does not read.
    """
    return ET.tostring(_Sdf(root, path).urdf(), encoding="unicode")


class _Sdf:
    def __init__(self, root: Element, path: Path) -> None:
        self._path = path
        if root.tag != "sdf":
            self._refuse(root, f"is not an SDF: its root is <{root.tag}>, not <sdf>")
        models: list[Any] = [*root.findall("model"), *root.findall("world/model")]
        if len(models) != 1:
            self._refuse(root, f"has {len(models)} models; use a file with one model per body")
        self._model = models[0]
        for tag in _REFUSED:
            for element in self._model.findall(tag):
                self._refuse(element, f"<{tag}> in a model is not supported; write its content out")
        self._refuse_unused()
        version = root.get("version", "1.7")
        if not _VERSION.fullmatch(version):
            self._refuse(root, f"its version is {version!r}, not a version such as 1.9")
        self._axis_in_model = [int(part) for part in version.split(".")[:2]] < [1, 5]
        for line, text in twins(self._model):
            raise WiringError(f"{path}:{line}: {text}")
        self._links = {link.get("name", ""): link for link in self._model.findall("link")}
        self._joints = {joint.get("name", ""): joint for joint in self._model.findall("joint")}
        self._children = {_word(joint, "child"): joint for joint in self._joints.values()}

    def _refuse_unused(self) -> None:
        for inertial in self._model.findall("link/inertial"):
            if inertial.get("auto") in {"true", "1"}:
                text = '<inertial auto="true"> is not supported; write its mass and inertia'
                self._refuse(inertial, text)
        for path, value in _UNUSED.items():
            for element in self._model.findall(path):
                text = (element.text or "").strip()
                same = {"1": "true", "0": "false"}.get(text, text)
                if same == value if value else _is_not_zero(text):
                    instead = ", and set `fixed_base: true` in the world" * (path == "static")
                    text = f"<{element.tag}> {text} is not supported; remove it{instead}"
                    self._refuse(element, text)

    def urdf(self) -> ET.Element:
        """Return the robot."""
        robot = ET.Element("robot", {"name": self._model.get("name", "model")})
        robot.extend([self._link(link) for link in self._links.values()])
        if any(_word(joint, "parent") == "world" for joint in self._joints.values()):
            robot.append(ET.Element("link", {"name": "world"}))
        robot.extend([self._joint(joint) for joint in self._joints.values()])
        return robot

    def _pose(self, element: Any, default: str = "", above: tuple[str, ...] = ()) -> Pose:
        """Return the pose of a link or joint in the model. default: what it is relative to."""
        pose = element.find("pose")
        given = "" if pose is None else pose.get("relative_to", pose.get("frame", ""))
        name = given or default
        own = self._own_pose(element)
        if name in {"", "__model__", "world"}:
            return own
        other = self._links.get(name, self._joints.get(name))
        if other is None or name in above:
            self._refuse(
                element,
                f"its pose is relative to {name!r}, which does not exist or refers back to it",
            )
        base = "" if name in self._links else _word(other, "child")
        return self._pose(other, base, (*above, name)) @ own

    def _own_pose(self, element: Any) -> Pose:
        pose = element.find("pose")
        values = self._numbers(pose, 6, [0.0] * 6)
        if pose is not None and pose.get("degrees") == "true":
            values[3:] = map(math.radians, values[3:])
        return pose_of_rpy(values[:3], values[3:])

    def _frame(self, link: str) -> Pose:
        """Return the frame of a link in the URDF, in the model."""
        joint = self._children.get(link)
        return IDENTITY if joint is None else self._pose(joint, link)

    def _link(self, link: Any) -> ET.Element:
        name = link.get("name", "")
        element = ET.Element("link", {"name": name})
        here = self._frame(name).inverse() @ self._pose(link)
        inertial = link.find("inertial")
        element.append(self._inertial(inertial, here))
        for tag in ("visual", "collision"):
            for shape in link.findall(tag):
                row = ET.SubElement(element, tag, {"name": shape.get("name", "")})
                row.append((here @ self._own_pose(shape)).origin())
                row.append(self._geometry(shape))
                color = shape.find("material/diffuse")
                if tag == "visual" and color is not None:
                    material = ET.SubElement(row, "material", {"name": f"{name}_{len(element)}"})
                    # A colour of three numbers is opaque.
                    count = min(len((color.text or "").split()) or 4, 4)
                    rgba = [*self._numbers(color, max(count, 3), [1.0] * 4), 1.0][:4]
                    ET.SubElement(material, "color", {"rgba": text_of(rgba)})
        return element

    def _inertial(self, inertial: Any, here: Pose) -> ET.Element:
        """Return mass and inertia, which are 1 kg and 1 kg·m² where SDF has none."""
        element = Element("inertial", {}) if inertial is None else inertial
        row = ET.Element("inertial")
        row.append((here @ self._own_pose(element)).origin())
        ET.SubElement(row, "mass", {"value": element.findtext("mass", "1").strip()})
        moments = {
            key: element.findtext(f"inertia/{key}", str(value)).strip()
            for key, value in _INERTIA.items()
        }
        ET.SubElement(row, "inertia", moments)
        return row

    def _geometry(self, shape: Any) -> ET.Element:
        geometry = ET.Element("geometry")
        given: Any = next(shape.iterfind("geometry/*"), None)
        tag = "nothing" if given is None else given.tag
        if tag == "mesh":
            uri = _word(given, "uri").replace("model://", "package://").removeprefix("file://")
            scale = given.findtext("scale", "1 1 1").strip()
            ET.SubElement(geometry, "mesh", {"filename": uri, "scale": scale})
        elif tag in {"box", "sphere", "cylinder", "capsule"}:
            ET.SubElement(geometry, tag, {part.tag: (part.text or "").strip() for part in given})
        else:
            self._refuse(
                shape,
                f"geometry {tag!r} is not supported; use a box, sphere, cylinder, capsule or mesh",
            )
        return geometry

    def _joint(self, joint: Any) -> ET.Element:
        name, joint_type = joint.get("name", ""), joint.get("type", "")
        if joint_type not in _TYPES:
            self._refuse(joint, f"joint {name!r} is {joint_type}, which is not supported")
        parent, child = _word(joint, "parent"), _word(joint, "child")
        pose = self._pose(joint, child)
        axis, limits = joint.find("axis"), self._limits(joint)
        if joint_type == "revolute" and "lower" not in limits:
            joint_type = "continuous"
        elif joint_type == "prismatic" and "lower" not in limits:
            self._refuse(joint, f"joint {name!r} is prismatic and has no <limit>")
        element = ET.Element("joint", {"name": name, "type": joint_type})
        element.append((self._frame(parent).inverse() @ pose).origin())
        ET.SubElement(element, "parent", {"link": parent})
        ET.SubElement(element, "child", {"link": child})
        if axis is not None and joint_type != "fixed":
            ET.SubElement(element, "axis", {"xyz": text_of(self._axis(axis, pose))})
            ET.SubElement(element, "limit", limits)
            self._add_mimic(axis.find("mimic"), element)
        return element

    def _add_mimic(self, mimic: Any, joint: ET.Element) -> None:
        """Add q = multiplier · (q of another joint - reference) + offset, as URDF has it."""
        if mimic is None:
            return
        multiplier, offset, reference = (
            self._numbers(mimic.find(key), 1, [default])[0]
            for key, default in (("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0))
        )
        values = {"multiplier": multiplier, "offset": offset - multiplier * reference}
        row = {key: repr(value) for key, value in values.items()}
        ET.SubElement(joint, "mimic", {"joint": mimic.get("joint", ""), **row})

    def _axis(self, axis: Any, pose: Pose) -> list[float]:
        """Return the axis of a joint in its own frame."""
        element = axis.find("xyz")
        vector = self._numbers(element, 3, [0.0, 0.0, 1.0])
        frame = "" if element is None else element.get("expressed_in", "")
        in_model = axis.findtext("use_parent_model_frame", "").strip() in {"1", "true"}
        if frame not in {"", "__model__"}:
            self._refuse(axis, f"an axis in the frame {frame!r} is not supported")
        is_turned = self._axis_in_model or in_model or frame == "__model__"
        return pose.inverse().turn(vector) if is_turned else vector

    def _limits(self, joint: Any) -> dict[str, str]:
        """Return effort and velocity, and lower and upper where these limit."""
        limit = joint.find("axis/limit")
        limits = {"effort": "1e12", "velocity": "1e12"}
        for key in () if limit is None else ("lower", "upper", "effort", "velocity"):
            (value,) = self._numbers(limit.find(key), 1, [-1.0])
            is_given = limit.find(key) is not None and abs(value) < _UNLIMITED
            if is_given and (value >= 0 or key in {"lower", "upper"}):
                limits[key] = repr(value)
        if ("lower" in limits) != ("upper" in limits):
            limits = {key: value for key, value in limits.items() if key not in {"lower", "upper"}}
        return limits

    def _numbers(self, element: Any, count: int, default: list[float]) -> list[float]:
        words = [] if element is None else (element.text or "").split()
        if not words:
            return list(default)
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != count:
            self._refuse(element, f"<{element.tag}> {' '.join(words)!r} is not {count} numbers")
        return values

    def _refuse(self, element: Any, text: str) -> Any:
        raise WiringError(f"{self._path}:{element.line}: {text}")


def _is_not_zero(text: str) -> bool:
    try:
        return float(text) != 0.0
    except ValueError:
        return True


def _word(element: Any, tag: str) -> str:
    child: Mapping[str, Any] | None = element.find(tag)
    text: str = "" if child is None else (element.findtext(tag) or "")
    return text.strip()
