"""What makes a URDF no robot that physics can move: each with its line.

Engines do not say so: PyBullet reads `mass value="heavy"` as 0, takes a negative mass, computes
with an inertia of zero where it is that of no body, and turns crossed limits into none. Pinocchio
drops such an <inertial>. What both handle alike, such as a massless link that stands still, passes.
"""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET
from xml.parsers import expat

from stepbus_schemas import suggest

_MOVING = ("revolute", "continuous", "prismatic")
_TYPES = (*_MOVING, "fixed", "floating", "planar", "spherical")
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_INFINITE = re.compile(r"\b(nan|inf(inity)?)\b|[eE]\+?\d{3}", re.IGNORECASE)
_DECLARATION = re.compile(r"<\?xml[^?]*\?>")
_SHOWN = 5
_NOISE = 1e-12
"""Moments of inertia below this are rounding errors of the program that wrote them [kg·m²]."""

LEFT_OUT = "left_out"
"""Of a robot that was cleaned, or made from another format: an element with a sentence on it."""

_Problems = Iterator[tuple[int, str]]
"""Line and sentence."""


class Element(ET.Element):
    """An element of a URDF; line: counted from 1."""

    line = 0


def parse_urdf(text: str) -> Element:
    """Return the root of a URDF; raises expat.ExpatError where it is no XML."""
    parser = expat.ParserCreate()

    def make(tag: Any, attributes: Any, /) -> Element:
        element = Element(tag, attributes)
        element.line = parser.CurrentLineNumber
        return element

    builder: ET.TreeBuilder = ET.TreeBuilder(element_factory=make)
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    # Line breaks stay: PyBullet cuts lines after 1023 characters.
    parser.CharacterDataHandler = builder.data
    # As engines do: blank lines or comments before the declaration, a zero behind the end.
    parser.Parse(_DECLARATION.sub("", text, count=1).rstrip("\0 \t\r\n"), True)
    root: Any = builder.close()
    return root  # type: ignore[no-any-return]  # what the factory made


@dataclass(frozen=True, kw_only=True)
class Mimic:
    """A joint that follows another one: q = multiplier · q of `joint` + offset [rad or m]."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


def mimics(root: Element) -> dict[str, Mimic]:
    """Return the joints of a checked URDF that follow another one."""
    joints = {}
    for joint in root.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None and joint.get("type") in _MOVING:
            values = {key: _value(mimic, key) for key in ("multiplier", "offset")}
            given = {key: value for key, value in values.items() if value is not None}
            joints[joint.get("name", "")] = Mimic(joint=mimic.get("joint", ""), **given)
    return joints


def urdf_problems(root: Element) -> list[tuple[int, str]]:
    """Return what is wrong with a robot: line and a sentence that names the link or joint."""
    if root.tag != "robot":
        return [(root.line, f"is not a URDF: its root is <{root.tag}>, not <robot>")]
    robot = _Robot(root)
    shape = [*robot.names(), *robot.joints()]
    # Where links and joints are unclear, nothing is known about what moves.
    tree = [] if shape else [*robot.tree(), *robot.massless()]
    return sorted([*shape, *tree, *robot.inertials(), *robot.poses()])


def urdf_warnings(root: Element) -> list[str]:
    """Return what engines compute otherwise than a robot without problems says, a sentence each.

    Some of them say what was changed when it was cleaned, or made from another format.

    There are well-known robots with such links; mostly these are small, or stand still.
    """
    robot = _Robot(root)
    left_out = [element.text or "" for element in root.findall(LEFT_OUT)]
    return [*left_out, *robot.frozen(), *robot.endless(), *robot.odd_poses()]


def twins(root: ET.Element) -> _Problems:
    """Yield links and joints with the name of another one."""
    for tag in ("link", "joint"):
        lines: dict[str | None, int] = {}
        elements: Sequence[Any] = root.findall(tag)
        for element in elements:
            name = element.get("name")
            if name in lines:
                text = f"{tag} {name!r} is defined twice, first in line {lines[name]}"
                yield element.line, text
            elif name:
                lines[name] = element.line


class _Robot:
    def __init__(self, root: Element) -> None:
        self._root = root
        self._links: Sequence[Any] = root.findall("link")
        self._joints: Sequence[Any] = root.findall("joint")
        self._by_name: dict[Any, Any] = {link.get("name"): link for link in self._links}
        self._children: dict[Any, list[Any]] = {}
        for joint in self._joints:
            self._children.setdefault(_end(joint, "parent"), []).append(_end(joint, "child"))

    def names(self) -> _Problems:
        """Yield links and joints without a name, or with that of another one."""
        if not self._links:
            yield self._root.line, "has no <link>"
        for element in (*self._links, *self._joints):
            if not element.get("name"):
                yield element.line, f"a <{element.tag}> has no name"
        yield from twins(self._root)

    def joints(self) -> _Problems:
        """Yield what is wrong with single joints: type, ends, limits."""
        for joint in self._joints:
            who, kind = _who(joint), joint.get("type")
            if kind not in _TYPES:
                yield joint.line, f"{who}: unknown type {kind!r}{suggest(kind, _TYPES)}"
            yield from self._mimic(joint, who)
            for end in ("parent", "child"):
                name = _end(joint, end)
                if name is None:
                    yield joint.line, f'{who} has no <{end} link="…"/>'
                elif name not in self._by_name:
                    text = f"{who}: unknown {end} link {name!r}{suggest(name, self._by_name)}"
                    yield joint.find(end).line, text
            yield from _limits(joint, who, kind)

    def _mimic(self, joint: Any, who: str) -> _Problems:
        """Yield what is wrong with the joint that a joint follows."""
        mimic = joint.find("mimic")
        if mimic is None:
            return
        moving = {other.get("name"): other for other in self._joints if _moves(other)}
        name = mimic.get("joint")
        if name not in moving:
            text = f"{who} follows joint {name!r}, which is not a movable joint"
            yield mimic.line, text + suggest(name, moving)
        elif (other := moving[name].find("mimic")) is not None:
            followed = other.get("joint")
            text = (
                f"{who} follows {name!r}, which follows {followed!r}; make both follow {followed!r}"
            )
            yield mimic.line, text
        for key in ("multiplier", "offset"):
            if mimic.get(key) is not None and _value(mimic, key) is None:
                text = f"{who}: {key}={mimic.get(key)!r} of <mimic> is not a finite number"
                yield mimic.line, text

    def tree(self) -> _Problems:
        """Yield why the joints make no tree of the links."""
        parents: dict[str, Any] = {}
        for joint in self._joints:
            child = _end(joint, "child")
            first = parents.setdefault(child, joint)
            if first is not joint:
                names = f"{first.get('name')!r} and {joint.get('name')!r}"
                text = f"link {child!r} is the child of joints {names}"
                yield joint.line, f"{text}; a robot must be a tree, closed chains are not supported"
        roots = [name for name in self._by_name if name not in parents]
        if len(roots) > 1:
            text = f"has {len(roots)} roots: {_some(roots)}; connect them with joints"
            yield self._by_name[roots[1]].line, text
            return
        reached = {name for root in roots for name in self._carried(root)}
        circle = [name for name in self._by_name if name not in reached]
        if circle:
            text = f"links {_some(circle)} form a closed chain of joints; a robot must be a tree"
            yield parents[circle[0]].line, text

    def _carried(self, link: str) -> list[str]:
        """Return a link and those that its joints carry."""
        names, left = {link: None}, [link]
        while left:
            children = self._children.get(left.pop(), ())
            left += [child for child in children if child not in names]
            names |= dict.fromkeys(children)
        return list(names)

    def massless(self) -> _Problems:
        """Yield links of mass 0 with an inertia, where a joint moves nothing else."""
        for joint, link, has_inertia in self._moved_without_mass():
            if has_inertia:
                moved = f"is moved by joint {joint.get('name')!r}"
                text = f"{_who(link)} has mass 0 but an inertia, and {moved}"
                yield link.find("inertial/mass").line, text

    def frozen(self) -> Iterator[str]:
        """Yield joints that move nothing but links without mass and inertia."""
        for joint, link, has_inertia in self._moved_without_mass():
            if not has_inertia:
                yield (
                    f"{_who(joint)} moves {_who(link)}, whose mass and inertia are 0: PyBullet "
                    "does not move it; remove its <inertial> to give it a negligible mass"
                )

    def endless(self) -> Iterator[str]:
        """Yield revolute and prismatic joints that give no stops."""
        remedies = {"revolute": "make it continuous, or give both", "prismatic": "give both"}
        for joint in self._joints:
            limit, kind = joint.find("limit"), joint.get("type")
            if kind in remedies and not {"lower", "upper"} & set(limit.attrib):
                yield (
                    f"{_who(joint)} is {kind} without lower and upper, which stand for 0 and 0 "
                    f"in a URDF; it moves without stops: {remedies[kind]}"
                )

    def _moved_without_mass(self) -> Iterator[tuple[Any, Any, bool]]:
        """Yield each joint that carries nothing but links declared as massless, and its link.

        The third is whether that has an inertia.
        """
        for joint in filter(_moves, self._joints):
            carried = [self._by_name[name] for name in self._carried(_end(joint, "child"))]
            masses = [link.find("inertial/mass") for link in carried]
            # A link without <inertial> is no mistake: it weighs next to nothing.
            is_massless = all(mass is not None and _value(mass, "value") == 0 for mass in masses)
            inertia = moments(carried[0])
            if is_massless and inertia is not None:
                yield joint, carried[0], any(inertia)

    def inertials(self) -> _Problems:
        """Yield masses and inertias that no link can have."""
        for link in self._links:
            inertials = link.findall("inertial")
            if len(inertials) > 1:
                yield (
                    inertials[1].line,
                    f"{_who(link)} has {len(inertials)} <inertial>; only one is allowed",
                )
            for inertial in inertials[:1]:
                yield from _mass(inertial, _who(link))
                yield from _inertia(inertial, _who(link))

    def poses(self) -> _Problems:
        """Yield origins and axes with a NaN or an infinity, and axes without a direction."""
        for owner, element, key, text in self._vectors():
            if _INFINITE.search(text):
                where = f"{key}={text!r} of <{element.tag}>"
                yield element.line, f"{_who(owner)}: {where} is not finite"
            elif element.tag != "axis" or key != "xyz" or not _moves(owner):
                continue
            elif not floats(text):
                # PyBullet reads 0 for a word that is no number.
                yield element.line, f"{_who(owner)}: its axis {text!r} must be three numbers"
            elif floats(text) == [0, 0, 0]:
                yield element.line, f"{_who(owner)}: its axis is 0 0 0, which has no direction"

    def odd_poses(self) -> Iterator[str]:
        """Yield origins and axes that are not three numbers."""
        for owner, element, key, text in self._vectors():
            if len(floats(text)) != 3:
                yield (
                    f"{_who(owner)}: {key}={text!r} of <{element.tag}> must be three numbers; "
                    "PyBullet reads a missing one as 0"
                )

    def _vectors(self) -> Iterator[tuple[Any, Any, str, str]]:
        """Yield each link or joint with its origins and axes, and their attributes."""
        for owner in (*self._links, *self._joints):
            for element in (*owner.iter("origin"), *owner.findall("axis")):
                for key in ("xyz", "rpy"):
                    if (text := element.get(key)) is not None:
                        yield owner, element, key, text


def _who(element: Any) -> str:
    return f"{element.tag} {element.get('name')!r}"


def _end(joint: Any, end: str) -> Any:
    """Return the link at an end of a joint, its `parent` or `child`."""
    element = joint.find(end)
    return None if element is None else element.get("link")


def _moves(joint: Any) -> bool:
    return joint.tag == "joint" and joint.get("type") in _MOVING


def _some(names: Sequence[Any]) -> str:
    return ", ".join([*names[:_SHOWN], *(["…"] if len(names) > _SHOWN else [])])


def _limits(joint: Any, who: str, kind: str | None) -> _Problems:
    limit, is_bounded = joint.find("limit"), kind in ("revolute", "prismatic")
    if limit is None:
        if is_bounded:
            instead = ", or make it continuous" if kind == "revolute" else ""
            text = f"is {kind} and has no <limit>; give lower, upper, effort and velocity{instead}"
            yield joint.line, f"{who} {text}"
        return
    for key in ("lower", "upper", "effort", "velocity"):
        value = _value(limit, key)
        if limit.get(key) is not None and value is None:
            yield limit.line, f"{who}: {key}={limit.get(key)!r} is not a finite number"
        elif value is not None and value < 0 and key in ("effort", "velocity"):
            yield limit.line, f"{who}: {key} {value:g} is negative"
    if not is_bounded:
        return
    lower, upper = _value(limit, "lower"), _value(limit, "upper")
    given = [key for key in ("lower", "upper") if limit.get(key) is not None]
    if len(given) == 1:
        yield limit.line, f"{who} has one limit, {given[0]!r}; give both lower and upper"
    elif lower is not None and upper is not None and lower > upper:
        yield limit.line, f"{who}: lower {lower:g} is above upper {upper:g}"


def _mass(inertial: Any, who: str) -> _Problems:
    mass = inertial.find("mass")
    if mass is None:
        text = f"{who}: its <inertial> has no <mass>; a massless link needs no <inertial>"
        yield inertial.line, text
        return
    value = _value(mass, "value")
    if value is None:
        yield mass.line, f"{who}: mass {mass.get('value')!r} is not a finite number [kg]"
    elif value < 0:
        yield mass.line, f"{who}: mass {value:g} kg is negative"


def _inertia(inertial: Any, who: str) -> _Problems:
    inertia = inertial.find("inertia")
    if inertia is None:
        yield inertial.line, f"{who}: its <inertial> has no <inertia>"
        return
    for key in MOMENTS:
        value, given = _value(inertia, key), inertia.get(key)
        text = ""
        if value is None:
            text = "is missing" if given is None else f"{given!r} is not a finite number [kg·m²]"
            yield inertia.line, f"{who}: {key} of its inertia {text}"
        elif key[1] == key[2] and value < -_NOISE:
            yield inertia.line, f"{who}: {key} {value:g} kg·m² of its inertia is negative"


def moments(link: Any) -> list[float] | None:
    """Return the six numbers of a link's inertia [kg·m²]; None where it has no such."""
    inertia = link.find("inertial/inertia")
    values = [] if inertia is None else [_value(inertia, key) for key in MOMENTS]
    known = [value for value in values if value is not None]
    return known if len(known) == len(MOMENTS) else None


def _value(element: Any, key: str) -> float | None:
    """Return the number of an attribute; None where it has none, or one that is not finite."""
    numbers = floats(element.get(key, ""))
    return numbers[0] if len(numbers) == 1 else None


def floats(text: str) -> list[float]:
    """Return the finite numbers of a text; nothing where one is not."""
    words = text.split()
    numbers = [float(word) for word in words if _NUMBER.fullmatch(word)]
    is_whole = len(numbers) == len(words) and all(map(math.isfinite, numbers))
    return numbers if is_whole else []
