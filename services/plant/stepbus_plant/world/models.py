"""Colours and collision shapes of links, read from the URDF.

The engine cannot report them: it turns a cylinder into a mesh, and gives shapes relative to the
centre of mass.
"""

import math
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pybullet as bullet

from stepbus_participant import package_path, parse_urdf, read_urdf_text, scratch_folder
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
    rotation = bullet.getQuaternionFromEuler(_numbers(link, given, "rpy", 3))
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


# S314: the files are the user's own, and expat itself stops an expansion without end.

# Negligible but not zero: PyBullet assumes 1 kg for a link without an inertial, and warns.
_TINY_INERTIAL = """<inertial><mass value="1e-6"/>
<inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial>"""

_MADE = {".xacro", ".sdf"}
"""Endings of files that a URDF is made from."""


@contextmanager
def loadable(urdf: Path, edit: Callable[[ET.Element], None] | None = None) -> Iterator[Path]:
    """Provide a URDF in which every link has an inertial, as a context manager.

    A link without one is massless by the definition of URDF and gets a negligible mass. A `.xacro`
    is expanded, an SDF converted. edit: further changes to the root of the file. A file that needs
    no change stays as it is. Raises WiringError with all that is wrong with the model.
    """
    text = read_urdf_text(urdf)
    root = parse_urdf(text)
    refuse_missing_meshes(urdf, root)
    links = [link for link in root.findall("link") if link.find("inertial") is None]
    if not links and urdf.suffix.lower() not in _MADE and edit is None:
        yield urdf
        return
    for link in links:
        link.append(ET.fromstring(_TINY_INERTIAL))  # noqa: S314
    if edit is not None:
        edit(root)
    yield from _copy(root, urdf)


def refuse_missing_meshes(urdf: Path, root: ET.Element | None = None) -> None:
    """Raise WiringError that lists the meshes of a model that are not there.

    PyBullet loads no such model. root: of its checked text, where that is known.
    """
    found = parse_urdf(read_urdf_text(urdf)) if root is None else root
    missing: dict[str, str] = {}
    for link in found.findall("link"):
        for mesh in link.iter("mesh"):
            name = mesh.get("filename", "")
            if not _is_file(Path(_absolute(name, urdf.parent))):
                text = f"link {link.get('name')!r}: no mesh {name!r}, in its folder or a package"
                missing.setdefault(name, f"{_place(urdf, mesh)}: {text}")
    if missing:
        raise WiringError("\n".join(missing.values()))


def _place(urdf: Path, element: Any) -> str:
    """Return a model's file with an element's line; of what is made from a file, the file."""
    return str(urdf) if urdf.suffix.lower() in _MADE else f"{urdf}:{element.line}"


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _copy(root: ET.Element, urdf: Path) -> Iterator[Path]:
    """Provide a copy of a model in a temporary folder."""
    for mesh in root.iter("mesh"):
        mesh.set("filename", _absolute(mesh.get("filename", ""), urdf.parent))
    with tempfile.TemporaryDirectory(prefix="stepbus-urdf-", dir=scratch_folder()) as folder:
        copy = Path(folder) / urdf.name.removesuffix(".xacro")
        ET.ElementTree(root).write(copy, encoding="utf-8")
        yield copy


def _absolute(file: str, folder: Path) -> str:
    """Return the absolute path of a file that a URDF in `folder` names; else the name itself.

    PyBullet searches a name, or the folder of a package, in the folders above the URDF too.
    """
    name = file.removeprefix("package://")
    paths = [parent / name for parent in (folder, *folder.parents)]
    if name != file:
        try:
            paths.insert(0, package_path(file))
        except WiringError:
            if ".." in name.split("/"):
                raise
    return next((str(path) for path in paths if _is_file(path)), file)


def pairs_without_collision(srdf: Path) -> list[tuple[str, str]]:
    """Return the pairs of links for which an SRDF disables collisions.

    Raises WiringError if the file cannot be read.
    """
    try:
        root = ET.parse(srdf).getroot()  # noqa: S314
    except (OSError, ET.ParseError) as exc:
        raise WiringError(f"{srdf}: cannot be read: {exc}") from exc
    rows = root.iter("disable_collisions")
    return [(row.get("link1", ""), row.get("link2", "")) for row in rows]
