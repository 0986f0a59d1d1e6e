"""What PyBullet does not do with model files as they are: xacro, massless links and SRDF."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree as ET

from stepbus_participant.config import package_path
from stepbus_participant.models import read_urdf_text
from stepbus_schemas import WiringError

# S314: the files are the user's own, and expat itself stops an expansion without end.

# As good as nothing, yet not zero: PyBullet takes a link without an inertial for 1 kg, and warns.
_TINY_INERTIAL = """<inertial><mass value="1e-6"/>
<inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial>"""


@contextmanager
def loadable(urdf: Path, edit: Callable[[ET.Element], None] | None = None) -> Iterator[Path]:
    """Give the path of a URDF in which every link has an inertial, for as long as it is needed.

    Links without one are massless by the URDF's definition, and are given next to nothing. A
    `.xacro` is expanded. edit: further changes to the root of the file. A file that needs no
    change, or is no XML, is given as it is. Raises WiringError when a `.xacro` cannot be expanded.
    """
    is_xacro = urdf.suffix.lower() == ".xacro"
    try:
        root = ET.fromstring(read_urdf_text(urdf)) if is_xacro else ET.parse(urdf).getroot()  # noqa: S314
    except ET.ParseError:
        yield urdf
        return
    links = [link for link in root.findall("link") if link.find("inertial") is None]
    if not links and not is_xacro and edit is None:
        yield urdf
        return
    for link in links:
        link.append(ET.fromstring(_TINY_INERTIAL))  # noqa: S314
    if edit is not None:
        edit(root)
    yield from _copy(root, urdf)


def _copy(root: ET.Element, urdf: Path) -> Iterator[Path]:
    """Give a copy of a model, in another folder, for as long as it is needed."""
    for mesh in root.iter("mesh"):
        mesh.set("filename", _absolute(mesh.get("filename", ""), urdf.parent))
    with tempfile.TemporaryDirectory(prefix="stepbus-urdf-") as folder:
        copy = Path(folder) / urdf.name.removesuffix(".xacro")
        ET.ElementTree(root).write(copy, encoding="utf-8")
        yield copy


def _absolute(file: str, folder: Path) -> str:
    """Return a file that a URDF in `folder` names such that a copy elsewhere finds it too."""
    if not file.startswith("package://"):
        return str(folder / file)
    try:
        candidates = [package_path(file)]
    except WiringError:
        # PyBullet takes the package for one of the folders above the URDF.
        name = file.removeprefix("package://")
        candidates = [parent / name for parent in (folder, *folder.parents)]
    return str(next((path for path in candidates if path.is_file()), file))


def pairs_without_collision(srdf: Path) -> list[tuple[str, str]]:
    """Return the pairs of links that an SRDF says never collide.

    Raises WiringError when the file cannot be read.
    """
    try:
        root = ET.parse(srdf).getroot()  # noqa: S314
    except (OSError, ET.ParseError) as exc:
        raise WiringError(f"{srdf}: cannot be read: {exc}") from exc
    rows = root.iter("disable_collisions")
    return [(row.get("link1", ""), row.get("link2", "")) for row in rows]
