"""What makes a URDF no robot that physics can move: each with its line.

Engines do not say so: PyBullet reads `mass value="heavy"` as 0, takes a negative mass, computes
with an inertia of zero where it is that of no body, and turns crossed limits into none. Pinocchio
drops such an <inertial>. What both handle alike, such as a massless link that stands still, passes.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET
from xml.parsers import expat

from .hints import suggest

MOVING = ("revolute", "continuous", "prismatic")
_TYPES = (*MOVING, "fixed", "floating", "planar", "spherical")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_INFINITE = re.compile(r"\b(nan|inf(inity)?)\b|[eE]\+?\d{3}", re.IGNORECASE)
_DECLARATION = re.compile(r"<\?xml[^?]*\?>")
_SHOWN = 5
_NOISE = 1e-12
"""Moments of inertia below this are rounding errors of whoever wrote the file [kg·m²]."""

Found = Iterator[tuple[int, str]]
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
        if mimic is not None and joint.get("type") in MOVING:
            values = {key: _value(mimic, key) for key in ("multiplier", "offset")}
            given = {key: value for key, value in values.items() if value is not None}
            joints[joint.get("name", "")] = Mimic(joint=mimic.get("joint", ""), **given)
    return joints


def urdf_problems(root: Element) -> list[tuple[int, str]]:
    """Return what is wrong with a robot: line and a sentence that names the link or joint."""
    if root.tag != "robot":
        return [(root.line, f"is no URDF: its root is <{root.tag}>, not <robot>")]
    robot = _Robot(root)
    shape = [*robot.names(), *robot.joints()]
    # Where links and joints are unclear, nothing is known about what moves.
    tree = [] if shape else [*robot.tree(), *robot.massless()]
    return sorted([*shape, *tree, *robot.inertials(), *robot.poses()])


def urdf_notes(root: Element) -> list[str]:
    """Return what engines compute otherwise than a robot without problems says, a sentence each.

    There are well-known robots with such links; mostly these are small, or stand still.
    """
    robot = _Robot(root)
    list(robot.tree())
    return [*robot.bodiless(), *robot.frozen(), *robot.odd_poses()]


class _Robot:
    def __init__(self, root: Element) -> None:
        self._root = root
        self._links: Sequence[Any] = root.findall("link")
        self._joints: Sequence[Any] = root.findall("joint")
        self._names: list[Any] = [link.get("name") for link in self._links]
        self._children: dict[str, list[str]] = {}

    def names(self) -> Found:
        """Yield links and joints without a name, or with that of another one."""
        if not self._links:
            yield self._root.line, "has no <link>"
        for tag, elements in (("link", self._links), ("joint", self._joints)):
            first: dict[str, int] = {}
            for element in elements:
                name = element.get("name")
                if not name:
                    yield element.line, f"a <{tag}> has no name"
                elif name in first:
                    text = f"{tag} {name!r} is there twice, first in line {first[name]}"
                    yield element.line, text
                else:
                    first[name] = element.line

    def joints(self) -> Found:
        """Yield what is wrong with single joints: type, ends, limits."""
        for joint in self._joints:
            who = f"joint {joint.get('name')!r}"
            kind = joint.get("type")
            if kind not in _TYPES:
                yield joint.line, f"{who}: unknown type {kind!r}{suggest(kind, _TYPES)}"
            yield from self._mimic(joint, who)
            for end in ("parent", "child"):
                element = joint.find(end)
                name = None if element is None else element.get("link")
                if name is None:
                    yield joint.line, f'{who} has no <{end} link="…"/>'
                elif name not in self._names:
                    text = f"{who}: its {end} {name!r} is no link{suggest(name, self._names)}"
                    yield element.line, text
            yield from _limits(joint, who, kind)

    def _mimic(self, joint: Any, who: str) -> Found:
        """Yield what is wrong with the joint that a joint follows."""
        mimic = joint.find("mimic")
        if mimic is None:
            return
        moving = {other.get("name"): other for other in self._joints if other.get("type") in MOVING}
        name = mimic.get("joint")
        if name not in moving:
            text = f"{who} follows joint {name!r}, which is none that moves"
            yield mimic.line, text + suggest(name, moving)
        elif moving[name].find("mimic") is not None:
            followed = moving[name].find("mimic").get("joint")
            text = f"{who} follows {name!r}, which follows {followed!r}; let both follow that"
            yield mimic.line, text
        for key in ("multiplier", "offset"):
            if mimic.get(key) is not None and _value(mimic, key) is None:
                text = f"{who}: {key}={mimic.get(key)!r} of <mimic> is no finite number"
                yield mimic.line, text

    def tree(self) -> Found:
        """Yield why the joints make no tree of the links."""
        parents: dict[str, Any] = {}
        for joint in self._joints:
            child = joint.find("child").get("link")
            if child in parents:
                first = parents[child].get("name")
                text = f"link {child!r} is the child of joints {first!r} and {joint.get('name')!r}"
                yield joint.line, f"{text}; a robot is a tree, closed chains are not supported"
            parents.setdefault(child, joint)
            above = joint.find("parent").get("link")
            self._children.setdefault(above, []).append(child)
        roots = [name for name in self._names if name not in parents]
        if len(roots) > 1:
            line = next(link.line for link in self._links if link.get("name") == roots[1])
            yield line, f"has {len(roots)} roots: {_some(roots)}; connect them by joints"
        reached = {name for root in roots for name in self._below(root)}
        circle = [name for name in self._names if name not in reached]
        if circle and len(roots) <= 1:
            line = parents[circle[0]].line
            yield line, f"links {_some(circle)} are in a circle of joints; a robot is a tree"

    def _below(self, name: str) -> list[str]:
        """Return a link and those that its joints carry."""
        names = {name: None}
        left = [name]
        while left:
            children = self._children.get(left.pop(), ())
            left += [child for child in children if child not in names]
            names |= dict.fromkeys(children)
        return list(names)

    def massless(self) -> Found:
        """Yield links of mass 0 with an inertia, where a joint moves nothing else."""
        for joint, link, has_inertia in self._massless():
            mass, name = link.find("inertial/mass"), link.get("name")
            if has_inertia:
                moved = f"is moved by joint {joint.get('name')!r}"
                yield mass.line, f"link {name!r} has mass 0, and an inertia, and {moved}"

    def frozen(self) -> Iterator[str]:
        """Yield joints that move nothing but links without mass and inertia."""
        for joint, link, has_inertia in self._massless():
            if not has_inertia:
                yield (
                    f"joint {joint.get('name')!r} moves link {link.get('name')!r}, whose mass and "
                    "inertia are 0: PyBullet keeps it where it is; without <inertial> it weighs "
                    "next to nothing, and moves"
                )

    def _massless(self) -> Iterator[tuple[Any, Any, bool]]:
        """Yield each joint that carries nothing but links declared as massless, and its link.

        The third is whether that has an inertia.
        """
        by_name = {link.get("name"): link for link in self._links}
        for joint in self._joints:
            if joint.get("type") not in MOVING:
                continue
            carried = [by_name[name] for name in self._below(joint.find("child").get("link"))]
            masses = [link.find("inertial/mass") for link in carried]
            # A link without <inertial> is no mistake: it weighs next to nothing.
            is_massless = all(mass is not None and _value(mass, "value") == 0 for mass in masses)
            moments = _moments(carried[0])
            if is_massless and moments is not None:
                yield joint, carried[0], any(moments.values())

    def inertials(self) -> Found:
        """Yield masses and inertias that no link can have."""
        for link in self._links:
            who = f"link {link.get('name')!r}"
            inertials = link.findall("inertial")
            if len(inertials) > 1:
                yield inertials[1].line, f"{who} has {len(inertials)} <inertial>"
            for inertial in inertials[:1]:
                yield from _mass(inertial, who)
                yield from _inertia(inertial, who)

    def bodiless(self) -> Iterator[str]:
        """Yield links whose inertia no body can have."""
        for link in self._links:
            moments = _moments(link)
            if moments is not None and _is_of_no_body(moments):
                yield (
                    f"link {link.get('name')!r}: its inertia is that of no body: a principal "
                    "moment is negative, or exceeds the sum of the other two; PyBullet computes "
                    "with an inertia of 0"
                )

    def poses(self) -> Found:
        """Yield origins and axes with a NaN or an infinity, and axes without a direction."""
        for owner in (*self._links, *self._joints):
            who = f"{owner.tag} {owner.get('name')!r}"
            for element in (*owner.iter("origin"), *owner.findall("axis")):
                for key in ("xyz", "rpy"):
                    text = element.get(key, "")
                    if _INFINITE.search(text):
                        where = f"{key}={text!r} of <{element.tag}>"
                        yield element.line, f"{who}: {where} is not finite"
            if owner.get("type") in MOVING:
                yield from _axes(owner, who)

    def odd_poses(self) -> Iterator[str]:
        """Yield origins and axes that are not three numbers."""
        for owner in (*self._links, *self._joints):
            for element in (*owner.iter("origin"), *owner.findall("axis")):
                for key in ("xyz", "rpy"):
                    text = element.get(key)
                    if text is not None and len(_floats(text)) != 3:
                        yield (
                            f"{owner.tag} {owner.get('name')!r}: {key}={text!r} of "
                            f"<{element.tag}> is not three numbers; PyBullet reads 0 where it "
                            "finds none"
                        )


def _some(names: Sequence[Any]) -> str:
    return ", ".join([*names[:_SHOWN], *(["…"] if len(names) > _SHOWN else [])])


def _axes(joint: Any, who: str) -> Found:
    """Yield axes that are no direction: PyBullet reads 0 for a word that is no number."""
    for axis in joint.findall("axis"):
        text = axis.get("xyz", "")
        if text.split() and not _floats(text) and not _INFINITE.search(text):
            yield axis.line, f"{who}: its axis {text!r} is not three numbers"
        elif _floats(text) == [0, 0, 0]:
            yield axis.line, f"{who}: its axis is 0 0 0, which has no direction"


def _limits(joint: Any, who: str, kind: str | None) -> Found:
    limit = joint.find("limit")
    if limit is None:
        if kind in ("revolute", "prismatic"):
            instead = " or make it continuous" if kind == "revolute" else ""
            text = f"is {kind} and has no <limit>; give lower, upper, effort and velocity,{instead}"
            yield joint.line, f"{who} {text.rstrip(',')}"
        return
    for key in ("lower", "upper", "effort", "velocity"):
        value = _value(limit, key)
        if limit.get(key) is not None and value is None:
            yield limit.line, f"{who}: {key}={limit.get(key)!r} is no finite number"
        elif value is not None and value < 0 and key in ("effort", "velocity"):
            yield limit.line, f"{who}: {key} {value:g} is negative"
    if kind not in ("revolute", "prismatic"):
        return
    lower, upper = _value(limit, "lower"), _value(limit, "upper")
    given = [key for key in ("lower", "upper") if limit.get(key) is not None]
    if len(given) == 1:
        yield limit.line, f"{who} has a limit {given[0]!r} only; give both lower and upper"
    elif lower is not None and upper is not None and lower > upper:
        yield limit.line, f"{who}: lower {lower:g} is above upper {upper:g}"


def _mass(inertial: Any, who: str) -> Found:
    mass = inertial.find("mass")
    if mass is None:
        yield inertial.line, f"{who}: its <inertial> has no <mass>; a link without any needs none"
        return
    value = _value(mass, "value")
    if value is None:
        yield mass.line, f"{who}: mass {mass.get('value')!r} is no finite number [kg]"
    elif value < 0:
        yield mass.line, f"{who}: mass {value:g} kg is negative"


def _inertia(inertial: Any, who: str) -> Found:
    inertia = inertial.find("inertia")
    if inertia is None:
        yield inertial.line, f"{who}: its <inertial> has no <inertia>"
        return
    keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    wrong = [key for key in keys if _value(inertia, key) is None]
    for key in wrong:
        given = inertia.get(key)
        text = "is missing" if given is None else f"{given!r} is no finite number [kg·m²]"
        yield inertia.line, f"{who}: {key} of its inertia {text}"
    for key in ("ixx", "iyy", "izz"):
        value = _value(inertia, key)
        if value is not None and value < -_NOISE:
            yield inertia.line, f"{who}: {key} {value:g} kg·m² of its inertia is negative"


def _moments(link: Any) -> Mapping[str, float] | None:
    """Return the six numbers of a link's inertia [kg·m²]; None where it has no such."""
    inertia = link.find("inertial/inertia")
    if inertia is None:
        return None
    values = {key: _value(inertia, key) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")}
    known = {key: value for key, value in values.items() if value is not None}
    return known if len(known) == len(values) else None


def _is_of_no_body(moments: Mapping[str, float]) -> bool:
    """Return whether a principal moment is negative, or exceeds the sum of the other two.

    One does where tr(I)/2 · 1 − I, the second moments of the mass, has a negative eigenvalue.
    """
    half = (moments["ixx"] + moments["iyy"] + moments["izz"]) / 2
    second = {key: (half if key[1] == key[2] else 0.0) - value for key, value in moments.items()}
    return not _is_positive(second)


def _is_positive(moments: Mapping[str, float]) -> bool:
    """Return whether a symmetric matrix has no negative eigenvalue, but for rounding errors.

    By Sylvester's criterion: no principal minor is negative. One part in a million passes.
    """
    largest = max(map(abs, moments.values()))
    slack = _NOISE + 1e-6 * largest
    xx, yy, zz = (moments[key] + slack for key in ("ixx", "iyy", "izz"))
    xy, xz, yz = moments["ixy"], moments["ixz"], moments["iyz"]
    determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    minors = (xx, yy, zz, xx * yy - xy * xy, xx * zz - xz * xz, yy * zz - yz * yz, determinant)
    return all(minor >= 0 for minor in minors)


def _value(element: Any, key: str) -> float | None:
    """Return the number of an attribute; None where it has none, or one that is not finite."""
    numbers = _floats(element.get(key, ""))
    return numbers[0] if len(numbers) == 1 else None


def _floats(text: str) -> list[float]:
    """Return the finite numbers of a text; nothing where one is not."""
    words = text.split()
    numbers = [float(word) for word in words if _NUMBER.fullmatch(word)]
    is_whole = len(numbers) == len(words) and all(map(math.isfinite, numbers))
    return numbers if is_whole else []
