"""Colours and collision shapes of links, read from the URDF.

The engine cannot report them: it turns a cylinder into a mesh, and gives shapes relative to the
centre of mass.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from stepbus_plant.geometry import quaternion
from stepbus_schemas import WiringError

_SIZES = {
    "box": {"size": 3},
    "capsule": {"radius": 1, "length": 1},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
}
"""Shape → its size attributes, and how many numbers each has; of other shapes, the name only."""


@dataclass(frozen=True)
class Appearance:
    """Collision shapes of a link in its frame, as text, and the colour of its visual."""

    shape: str = ""
    color: str = ""


def read_appearances(urdf: bytes) -> Mapping[str, Appearance]:
    """Return link → its appearance; lengths [m], quaternions x, y, z, w, colours r, g, b (0 to 1).

    Empty for a model that is not XML. Raises WiringError for an attribute that is not numeric.
    """
    try:
        # S314: the file is the user's own, and expat itself stops an expansion without end.
        root = ET.fromstring(urdf)  # noqa: S314
    except ET.ParseError:
        return {}
    palette = {
        material.get("name", ""): color
        for material in root.iter("material")
        if (color := material.find("color")) is not None
    }
    return {
        link.get("name", ""): Appearance("; ".join(_shapes(link)), _color(link, palette))
        for link in root.findall("link")
    }


def _shapes(link: ET.Element) -> Iterator[str]:
    for collision in link.findall("collision"):
        geometry = collision.find("geometry/*")
        if geometry is not None:
            sizes = _SIZES.get(geometry.tag, {})
            size = [x for key, n in sizes.items() for x in _numbers(link, geometry, key, n)]
            pose = _pose(link, collision.find("origin"))
            yield " ".join([geometry.tag, *map(_text, size), "@", *map(_text, pose)])


def _pose(link: ET.Element, origin: ET.Element | None) -> list[float]:
    """Return x, y, z and the quaternion of an origin; None: the link's origin."""
    zeros = {"xyz": "0 0 0", "rpy": "0 0 0"}
    given = ET.Element("origin", zeros if origin is None else {**zeros, **origin.attrib})
    rotation = quaternion(_numbers(link, given, "rpy", 3))
    return [*_numbers(link, given, "xyz", 3), *rotation]


def _color(link: ET.Element, palette: Mapping[str, ET.Element]) -> str:
    material = link.find("visual/material")
    color = None if material is None else palette.get(material.get("name", ""))
    if material is not None and (own := material.find("color")) is not None:
        color = own
    return "" if color is None else " ".join(map(_text, _numbers(link, color, "rgba", 4)[:3]))


def _numbers(link: ET.Element, element: ET.Element, key: str, count: int) -> list[float]:
    """Return the numbers of an attribute."""
    text = element.get(key, "")
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    # PyBullet silently reads an invalid size as 0.
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise WiringError(
            f"link {link.get('name')!r}: {key}={text!r} of <{element.tag}> is not "
            f"{count} number{'s' * (count > 1)}"
        )
    return numbers


def _text(number: float) -> str:
    # Nine digits hide the last bits of sines; adding 0 removes the sign of a zero.
    return f"{round(number, 9) + 0.0:.9g}"
