"""Models that engines load, and the pairs of links that an SRDF leaves out."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

from stepbus_models import Inertial, RobotDescription, is_file, urdf_text
from stepbus_participant import scratch_folder
from stepbus_schemas import WiringError

_TINY = Inertial(mass=1e-6, moments=(1e-9, 1e-9, 1e-9, 0.0, 0.0, 0.0))
"""Negligible but not zero: PyBullet assumes 1 kg for a link without an inertial, and warns."""


@contextmanager
def loadable(robot: RobotDescription) -> Iterator[Path]:
    """Provide the file of a robot that engines load, as a context manager.

    A URDF in which every link has an inertial: a link without one is massless by the definition of
    URDF and gets a negligible mass. An MJCF stays as it is. Raises WiringError for missing meshes.
    """
    if robot.format == "mjcf":
        yield robot.path
        return
    refuse_missing_meshes(robot)
    links = {
        name: link if link.inertial else replace(link, inertial=_TINY)
        for name, link in robot.links.items()
    }
    with tempfile.TemporaryDirectory(prefix="stepbus-urdf-", dir=scratch_folder()) as folder:
        urdf = Path(folder) / robot.path.name.removesuffix(".xacro")
        urdf.write_bytes(urdf_text(replace(robot, links=links)).encode())
        yield urdf


def is_mjcf(path: Path) -> bool:
    """Return whether a model is an MJCF: XML whose root is <mujoco>."""
    # S314: see below.
    _, element = next(ET.iterparse(path, events=["start"]))  # noqa: S314
    return bool(element.tag == "mujoco")


def refuse_missing_meshes(robot: RobotDescription) -> None:
    """Raise WiringError that lists the meshes of a robot that are not there."""
    missing: dict[str, str] = {}
    for link in robot.links.values():
        for shape in (*link.visuals, *link.collisions):
            if shape.kind == "mesh" and not is_file(Path(shape.mesh)):
                text = f"link {link.name!r}: mesh {shape.mesh!r} not found"
                missing.setdefault(shape.mesh, f"{robot.place(shape.line)}: {text}")
    if missing:
        raise WiringError("\n".join(missing.values()))


def pairs_without_collision(srdf: Path) -> list[tuple[str, str]]:
    """Return the pairs of links for which an SRDF disables collisions.

    Raises WiringError if the file cannot be read.
    """
    try:
        # S314: the file is the user's own, and expat itself stops an expansion without end.
        root = ET.parse(srdf).getroot()  # noqa: S314
    except (OSError, ET.ParseError) as exc:
        raise WiringError(f"cannot read {srdf}: {exc}") from exc
    return [(e.get("link1", ""), e.get("link2", "")) for e in root.iter("disable_collisions")]
