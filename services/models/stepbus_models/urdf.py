"""URDF, checked and read once: every problem with its line.

Engines do not report problems: PyBullet reads `mass value="heavy"` as 0, takes a negative mass,
computes with an inertia of zero where it is that of no body, and turns crossed limits into none.
Pinocchio drops such an <inertial>. Where engines differ, the description says what all use: axes
have the length 1, continuous joints no stops, and inertias are those of bodies.
"""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree as ET
from xml.parsers import expat

from stepbus_participant import package_path, suggest
from stepbus_schemas import Point, WiringError

from .description import Inertial, Joint, Link, Mimic, Pose, RobotDescription, Shape
from .inertia import balanced

_MOVING = ("revolute", "continuous", "prismatic")
_INSTEAD = {
    "floating": "remove it and its parent link: a body without `fixed_base` floats",
    "planar": "use two prismatic joints and a revolute one",
    "spherical": "use three revolute joints",
}
"""Type of a joint that is not supported → what to use."""
_TYPES = (*_MOVING, "fixed")
_DIAGONAL = ("ixx", "iyy", "izz")
_PRODUCTS = ("ixy", "ixz", "iyz")
_SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
}
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_INFINITE = re.compile(r"\b(nan|inf(inity)?)\b|[eE]\+?\d{3}", re.IGNORECASE)
_UNIT = re.compile(rb"""<unit\b[^>]*?\bmeter\s*=\s*["']\s*([^"'\s]+)""")
_DECLARATION = re.compile(r"<\?xml[^?]*\?>")
_NOISE = 1e-12
"""Moments of inertia below this are rounding errors of the program that wrote them [kg·m²]."""
_ROUNDING = 1e-12
"""Of an axis of length 1."""


class Element(ET.Element):
    """An element of a URDF.

    line: counted from 1. owner: the link or joint that it is part of, such as `link 'base'`.
    """

    line = 0
    owner = ""


def parse(text: str) -> Element:
    """Return the root element of XML; raises expat.ExpatError where the text is none."""
    parser, owner = expat.ParserCreate(), ""

    def make(tag: Any, attributes: Any, /) -> Element:
        nonlocal owner
        element = Element(tag, attributes)
        if tag in {"link", "joint"}:
            owner = f"{tag} {element.get('name')!r}"
        element.line, element.owner = parser.CurrentLineNumber, owner
        return element

    builder: ET.TreeBuilder = ET.TreeBuilder(element_factory=make)
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    # As engines do: blank lines or comments before the declaration, a zero behind the end.
    parser.Parse(_DECLARATION.sub("", text, count=1).rstrip("\0 \t\r\n"), True)
    root: Any = builder.close()
    return root  # type: ignore[no-any-return]  # what the factory made


def read_urdf(root: Element, path: Path, text: str, *, is_made: bool) -> RobotDescription:
    """Return the robot of a URDF.

    text: that `root` was parsed from; is_made: by expansion, so its lines are not those of `path`.
    Raises WiringError that lists every problem, one a line.
    """
    if is_made:
        elements: Any = root.iter()
        for element in elements:
            element.line = 0
    return _Reader(path, root).robot(text)


class _Reader:
    """Reads a robot, and collects its problems: line and message."""

    def __init__(self, path: Path, root: Element) -> None:
        self._problems: list[tuple[int, str]] = []
        self._folder, self._root = path.absolute().parent, root
        self._path = path
        self._warnings: list[str] = []
        self._links: Sequence[Any] = root.findall("link")
        self._joints: Sequence[Any] = root.findall("joint")
        self._by_name: dict[Any, Any] = {link.get("name"): link for link in self._links}
        self._moving = {j.get("name"): j for j in self._joints if j.get("type") in _MOVING}
        self._palette: dict[str | None, Any] = {}
        for material in (*root.findall("material"), *root.iter("material")):
            if (color := material.find("color")) is not None:
                self._palette.setdefault(material.get("name"), color)

    def robot(self, text: str) -> RobotDescription:
        """Return the robot; raises WiringError."""
        if self._root.tag != "robot":
            found = f"is not a URDF: its root is <{self._root.tag}>, not <robot>"
            self._problem(self._root, found)
            self._refuse()
        self._check_names()
        for joint in self._joints:
            self._check_ends(joint)
        # Where links and joints are unclear, nothing is known about their tree.
        root = "" if self._problems else self._check_tree()
        links = {link.get("name"): self._link(link) for link in self._links}
        joints = {joint.get("name"): self._joint(joint) for joint in self._joints}
        self._refuse()
        parents = {joint.parent for joint in joints.values()}
        for joint in filter(lambda joint: joint.moves, joints.values()):
            # Engines differ in what they do with a mass and an inertia of 0 that a joint moves.
            inertial = links[joint.child].inertial
            if inertial and not (inertial.mass or any(inertial.moments)):
                links[joint.child] = replace(links[joint.child], inertial=None)
            elif inertial and joint.child not in parents and _is_needle(joint, inertial):
                self._warnings.append(
                    f"link {joint.child!r} has no moment of inertia about the axis of joint "
                    f"{joint.name!r}, which PyBullet does not move and MuJoCo moves at once"
                )
        return RobotDescription(
            name=self._root.get("name", ""),
            path=self._path,
            format="urdf",
            root=root,
            links=links,
            joints=joints,
            warnings=tuple(self._warnings),
            text=text,
        )

    def _problem(self, element: Any, text: str) -> None:
        self._problems.append((element.line, text))

    def _refuse(self) -> None:
        if self._problems:
            at = ((f":{line}" if line else "", text) for line, text in sorted(self._problems))
            raise WiringError("\n".join(f"{self._path}{line}: {text}" for line, text in at))

    # --- the tree -------------------------------------------------------------------------

    def _check_names(self) -> None:
        """Find links and joints without a name, or with that of another one."""
        if not self._links:
            self._problem(self._root, "has no <link>")
        for elements in (self._links, self._joints):
            names: set[str] = set()
            for element in elements:
                name = element.get("name")
                if not name:
                    self._problem(element, f"a <{element.tag}> has no name")
                elif name in names:
                    self._problem(element, f"{element.owner} is defined twice")
                names.add(name)

    def _check_ends(self, joint: Any) -> None:
        """Find what is wrong with type and links of a joint."""
        who, kind = joint.owner, joint.get("type")
        if kind not in _TYPES:
            remedy = f"; {_INSTEAD[kind]}" if kind in _INSTEAD else suggest(kind, _TYPES)
            self._problem(joint, f"{who} is {kind!r}, which is not supported{remedy}")
        for end in ("parent", "child"):
            name = _end(joint, end)
            if name is None:
                self._problem(joint, f'{who} has no <{end} link="…"/>')
            elif name not in self._by_name:
                text = f"{who}: unknown {end} link {name!r}{suggest(name, self._by_name)}"
                self._problem(joint.find(end), text)

    def _check_tree(self) -> str:
        """Return the root link; an empty name where the joints make no tree of the links."""
        parents: dict[str, Any] = {}
        for joint in self._joints:
            child = _end(joint, "child")
            first = parents.setdefault(child, joint)
            if first is not joint:
                names = f"{first.get('name')!r} and {joint.get('name')!r}"
                text = f"link {child!r} is the child of joints {names}"
                text = f"{text}; a robot must be a tree, closed chains are not supported"
                self._problem(joint, text)
        roots = [name for name in self._by_name if name not in parents]
        if len(roots) > 1:
            text = f"has {len(roots)} roots: {', '.join(roots)}; connect them with joints"
            self._problem(self._by_name[roots[1]], text)
            return ""
        reached, new = set(roots), set(roots)
        while new:
            new = {name for name, j in parents.items() if _end(j, "parent") in new}
            reached |= new
        if circle := [name for name in self._by_name if name not in reached]:
            text = "form a closed chain of joints; a robot must be a tree"
            self._problem(parents[circle[0]], f"links {', '.join(circle)} {text}")
        return str(roots[0]) if roots else ""

    # --- links ----------------------------------------------------------------------------

    def _link(self, link: Any) -> Link:
        contact = {}
        for value in link.findall("contact/*"):
            # What has no value is a switch.
            is_switch = "value" not in value.attrib
            contact[value.tag] = 1.0 if is_switch else self._number(value, "value")
        return Link(
            name=link.get("name", ""),
            inertial=self._inertial(link),
            visuals=tuple(self._shapes(link, "visual")),
            collisions=tuple(self._shapes(link, "collision")),
            contact=contact,
            line=link.line,
        )

    def _inertial(self, link: Any) -> Inertial | None:
        who, inertials = link.owner, link.findall("inertial")
        if not inertials:
            return None
        if len(inertials) > 1:
            text = f"{who} has {len(inertials)} <inertial>; only one is allowed"
            self._problem(inertials[1], text)
        parts = {tag: inertials[0].find(tag) for tag in ("mass", "inertia")}
        for tag, part in parts.items():
            if part is None:
                text = "; a massless link needs no <inertial>" if tag == "mass" else ""
                self._problem(inertials[0], f"{who}: its <inertial> has no <{tag}>{text}")
        if None in parts.values():
            return None
        mass = self._number(parts["mass"], "value", least=0.0)
        inertia = parts["inertia"]
        xx, yy, zz = (self._number(inertia, key, least=-_NOISE) for key in _DIAGONAL)
        xy, xz, yz = (self._number(inertia, key) for key in _PRODUCTS)
        repaired, warning = balanced((xx, yy, zz, xy, xz, yz))
        self._warnings += [f"{who}: {warning}"] if warning else []
        return Inertial(mass=mass, moments=repaired, pose=self._pose(inertials[0]))

    def _shapes(self, link: Any, tag: str) -> Iterator[Shape]:
        for element in link.findall(tag):
            geometry = element.find("geometry/*")
            if geometry is None:
                continue
            kind = geometry.tag
            if kind not in {*_SIZES, "mesh", "plane"}:
                known = ", ".join([*_SIZES, "mesh"])
                text = f"{link.owner}: a <{tag}> is a <{kind}>, which is not one of {known}"
                self._problem(geometry, text)
                continue
            yield Shape(
                kind=kind,
                size=tuple(self._size(geometry)),
                mesh=self._mesh(geometry) if kind == "mesh" else "",
                pose=self._pose(element),
                rgba=self._rgba(element),
                is_concave=element.get("concave") == "yes",
                line=geometry.line,
            )

    def _size(self, geometry: Any) -> list[float]:
        if geometry.tag == "plane":
            return list(self._vector(geometry, "normal", (0.0, 0.0, 1.0)))
        if geometry.tag == "mesh":
            if "scale" not in geometry.attrib:
                return [1.0, 1.0, 1.0]
            count = 1 if len(geometry.get("scale").split()) == 1 else 3
            return self._numbers(geometry, "scale", count) * (3 // count)
        sizes = _SIZES[geometry.tag].items()
        return [x for key, count in sizes for x in self._numbers(geometry, key, count)]

    def _mesh(self, geometry: Any) -> str:
        """Return the absolute path of a mesh; its name, if there is no such file.

        PyBullet searches a name, or the folder of a package, in the folders above the URDF too.
        """
        name = geometry.get("filename", "")
        try:
            if name.startswith("package://"):
                paths = [package_path(name, self._folder)]
            else:
                file = unquote(name.removeprefix("file://")) if "://" in name else name
                paths = [folder / file for folder in (self._folder, *self._folder.parents)]
        except WiringError as exc:
            if ".." in name.split("/"):
                self._problem(geometry, f"{geometry.owner}: {exc}")
            return str(name)
        return next((str(path) for path in paths if is_file(path)), str(name))

    def _rgba(self, element: Any) -> tuple[float, ...] | None:
        material = element.find("material")
        if material is None:
            return None
        own = material.find("color")
        color = self._palette.get(material.get("name")) if own is None else own
        return None if color is None else tuple(self._numbers(color, "rgba", 4))

    # --- joints ---------------------------------------------------------------------------

    def _joint(self, joint: Any) -> Joint:
        kind = joint.get("type")
        limits = self._limits(joint, kind) if kind in _MOVING else {}
        is_endless = kind == "continuous" or "lower" not in limits
        dynamics = joint.find("dynamics")
        resistance = {} if dynamics is None else self._given(dynamics, "damping", "friction")
        if kind == "revolute" and is_endless:
            kind = "continuous"
        return Joint(
            name=joint.get("name", ""),
            type=kind,
            parent=_end(joint, "parent") or "",
            child=_end(joint, "child") or "",
            pose=self._pose(joint),
            axis=self._axis(joint) if kind in _MOVING else (1.0, 0.0, 0.0),
            lower=None if is_endless else limits.get("lower"),
            upper=None if is_endless else limits.get("upper"),
            effort=limits.get("effort"),
            velocity=limits.get("velocity"),
            **resistance,
            mimic=self._mimic(joint) if kind in _MOVING else None,
            line=joint.line,
        )

    def _limits(self, joint: Any, kind: str) -> dict[str, float]:
        """Return the limits of a joint: effort and velocity too, where it has any."""
        limit, is_bounded = joint.find("limit"), kind in ("revolute", "prismatic")
        if limit is None:
            if is_bounded:
                text = f"{joint.owner} is {kind} and has no <limit>; give lower, upper, effort and"
                instead = ", or make it continuous" if kind == "revolute" else ""
                self._problem(joint, f"{text} velocity{instead}")
            return {}
        motor = self._given(limit, "effort", "velocity", least=0.0)
        values = {"effort": 0.0, "velocity": 0.0, **motor}
        values |= self._given(limit, "lower", "upper")
        given = [key for key in ("lower", "upper") if key in values]
        if is_bounded and len(given) == 1:
            text = f"{joint.owner} has one limit, {given[0]!r}; give both lower and upper"
            self._problem(limit, text)
        elif is_bounded and not given:
            remedy = "make it continuous, or give both" if kind == "revolute" else "give both"
            self._warnings.append(
                f"{joint.owner} is {kind} without lower and upper, which stand for 0 and 0 in a "
                f"URDF; it moves without stops: {remedy}"
            )
        elif is_bounded and values["lower"] > values["upper"]:
            text = f"{joint.owner}: lower {values['lower']:g} is above upper {values['upper']:g}"
            self._problem(limit, text)
        return values

    def _mimic(self, joint: Any) -> Mimic | None:
        mimic = joint.find("mimic")
        if mimic is None:
            return None
        name = mimic.get("joint")
        if name not in self._moving:
            text = f"{joint.owner} follows joint {name!r}, which is not a movable joint"
            self._problem(mimic, text + suggest(name, self._moving))
        elif (other := self._moving[name].find("mimic")) is not None:
            followed = other.get("joint")
            text = f"follows {name!r}, which follows {followed!r}; make both follow {followed!r}"
            self._problem(mimic, f"{joint.owner} {text}")
        return Mimic(joint=name, **self._given(mimic, "multiplier", "offset"))

    def _axis(self, joint: Any) -> Point:
        """Return the axis of a joint that moves, with the length 1."""
        axis = joint.find("axis")
        if axis is None or "xyz" not in axis.attrib:
            return 1.0, 0.0, 0.0
        x, y, z = self._numbers(axis, "xyz", 3)
        length = math.hypot(x, y, z)
        if not length:
            self._problem(axis, f"{joint.owner}: its axis is 0 0 0, which has no direction")
        if not length or abs(length - 1.0) < _ROUNDING:
            return x, y, z
        return x / length, y / length, z / length

    # --- numbers --------------------------------------------------------------------------

    def _pose(self, element: Any) -> Pose:
        origin = element.find("origin")
        xyz, rpy = (self._vector(origin, key, (0.0, 0.0, 0.0)) for key in ("xyz", "rpy"))
        return Pose(xyz=xyz, rpy=rpy)

    def _vector(self, element: Any, key: str, default: Point) -> Point:
        """Return three numbers; with a warning, the default where they are others."""
        text = None if element is None else element.get(key)
        numbers = _floats(text or "")
        if len(numbers) == 3:
            return numbers[0], numbers[1], numbers[2]
        if text is not None:
            where = (
                f"{element.owner}: {key}={text!r} of <{element.tag}> is not three finite numbers"
            )
            if _INFINITE.search(text):
                self._problem(element, where)
            self._warnings.append(f"{where}, and is left out")
        return default

    def _number(self, element: Any, key: str, *, least: float = -math.inf) -> float:
        """Return the number of an attribute."""
        return self._numbers(element, key, 1, least=least)[0]

    def _numbers(
        self, element: Any, key: str, count: int, *, least: float = -math.inf
    ) -> list[float]:
        """Return the numbers of an attribute; ones where it has others, or one below `least`."""
        numbers = _floats(element.get(key, ""))
        if len(numbers) == count and min(numbers) >= least:
            return numbers
        given = f"{key}={element.get(key)!r}" if key in element.attrib else f"a missing {key}"
        wanted = f"{count} finite numbers" if count > 1 else "a finite number"
        wanted += "" if least == -math.inf else ", at least 0"
        self._problem(element, f"{element.owner}: {given} of <{element.tag}> must be {wanted}")
        return [1.0] * count

    def _given(self, element: Any, *keys: str, least: float = -math.inf) -> dict[str, float]:
        """Return the numbers of those attributes that an element has."""
        given = [key for key in keys if key in element.attrib]
        return {key: self._number(element, key, least=least) for key in given}


def is_file(path: Path) -> bool:
    """Return whether a path is a file; no for one that no system can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def mesh_unit(file: str) -> float:
    """Return the length of the unit of a Collada file [m]; 1 for a file of another format.

    PyBullet scales meshes by it; coal, which reads them for Pinocchio, does not (3.0.3).
    """
    found = _UNIT.search(Path(file).read_bytes()) if file.lower().endswith(".dae") else None
    return float(found[1]) if found else 1.0


def _is_needle(joint: Joint, inertial: Inertial) -> bool:
    """Return whether a mass has no moment about the axis of a joint; no where that is turned."""
    (x, y, z), (a, b, c) = joint.axis, inertial.pose.xyz
    xx, yy, zz, xy, xz, yz = inertial.moments
    if joint.type == "prismatic" or (any(inertial.moments) and any(inertial.pose.rpy)):
        return False
    own = xx * x * x + yy * y * y + zz * z * z + 2 * (xy * x * y + xz * x * z + yz * y * z)
    arm = math.hypot(y * c - z * b, z * a - x * c, x * b - y * a)
    return own + inertial.mass * arm * arm < _NOISE


def _end(joint: Any, end: str) -> Any:
    """Return the name of a joint's `parent` or `child` link."""
    element = joint.find(end)
    return None if element is None else element.get("link")


def _floats(text: str) -> list[float]:
    """Return the finite numbers of a text; nothing where one is not."""
    words = text.split()
    numbers = [float(word) for word in words if _NUMBER.fullmatch(word)]
    is_whole = len(numbers) == len(words) and all(map(math.isfinite, numbers))
    return numbers if is_whole else []
