"""Models that engines load, and the pairs of links that an SRDF leaves out."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from stepbus_participant import package_path, parse_urdf, read_model, scratch_folder
from stepbus_schemas import WiringError

# S314: the files are the user's own, and expat itself stops an expansion without end.

# Negligible but not zero: PyBullet assumes 1 kg for a link without an inertial, and warns.
_TINY_INERTIAL = """<inertial><mass value="1e-6"/>
<inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial>"""

_INSTEAD = {
    "floating": "remove it and its parent link: a body without `fixed_base` floats",
    "planar": "use two prismatic joints and a revolute one",
    "spherical": "use three revolute joints",
}
"""Type of a joint that the plant does not support → what to use."""


@contextmanager
def loadable(urdf: Path, edit: Callable[[ET.Element], None] | None = None) -> Iterator[Path]:
    """Provide a URDF in which every link has an inertial, as a context manager.

    A link without one is massless by the definition of URDF and gets a negligible mass. A `.xacro`
    is expanded, an SDF or MJCF converted. edit: further changes to the root of the file. A file
    that needs no change stays as it is. Raises WiringError with all that is wrong with the model.
    """
    text, is_made = read_model(urdf)
    root = parse_urdf(text)
    _refuse_missing_meshes(urdf, root, is_made=is_made)
    _refuse_unsupported(urdf, root)
    links = [link for link in root.findall("link") if link.find("inertial") is None]
    if not links and not is_made and edit is None:
        yield urdf
        return
    for link in links:
        link.append(ET.fromstring(_TINY_INERTIAL))  # noqa: S314
    if edit is not None:
        edit(root)
    for mesh in root.iter("mesh"):
        mesh.set("filename", mesh_path(mesh.get("filename", ""), urdf.parent))
    with tempfile.TemporaryDirectory(prefix="stepbus-urdf-", dir=scratch_folder()) as folder:
        copy = Path(folder) / urdf.name.removesuffix(".xacro")
        ET.ElementTree(root).write(copy, encoding="utf-8")
        yield copy


def is_mjcf(path: Path) -> bool:
    """Return whether a model is an MJCF: XML whose root is <mujoco>. What is no XML is none."""
    try:
        for _, element in ET.iterparse(path, events=["start"]):  # noqa: S314
            return bool(element.tag == "mujoco")
    except (OSError, ET.ParseError):
        pass
    return False


def refuse_missing_meshes(urdf: Path) -> None:
    """Raise WiringError that lists the meshes of a model that are not there.

    PyBullet loads no such model. MuJoCo itself says what is wrong with an MJCF.
    """
    if is_mjcf(urdf):
        return
    text, is_made = read_model(urdf)
    _refuse_missing_meshes(urdf, parse_urdf(text), is_made=is_made)


def _refuse_missing_meshes(urdf: Path, root: ET.Element, *, is_made: bool) -> None:
    missing: dict[str, str] = {}
    for link in root.findall("link"):
        meshes: Iterator[Any] = link.iter("mesh")
        for mesh in meshes:
            name = mesh.get("filename", "")
            if not _is_file(Path(mesh_path(name, urdf.parent))):
                text = f"link {link.get('name')!r}: mesh {name!r} not found"
                place = str(urdf) if is_made else f"{urdf}:{mesh.line}"
                missing.setdefault(name, f"{place}: {text}")
    if missing:
        raise WiringError("\n".join(missing.values()))


def _refuse_unsupported(urdf: Path, root: ET.Element) -> None:
    """Raise WiringError that lists the joints of a model that the plant does not support."""
    types = ((joint.get("name"), joint.get("type", "")) for joint in root.findall("joint"))
    lines = [
        f"{urdf}: joint {name!r} is {joint_type}, which is not supported; {_INSTEAD[joint_type]}"
        for name, joint_type in types
        if joint_type in _INSTEAD
    ]
    if lines:
        raise WiringError("\n".join(lines))


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def mesh_path(file: str, folder: Path) -> str:
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
        raise WiringError(f"cannot read {srdf}: {exc}") from exc
    return [(e.get("link1", ""), e.get("link2", "")) for e in root.iter("disable_collisions")]
