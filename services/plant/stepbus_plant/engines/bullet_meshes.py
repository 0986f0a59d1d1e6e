"""Meshes that PyBullet does not read, written so that it does (3.2.7).

It takes an STL written as text for a mesh without triangles: the link has no shape, and a camera
does not see it. Of a file that is no STL, OBJ or DAE, it says that the URDF cannot be loaded.
"""

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from stepbus_models import Shape, read_robot, urdf_text
from stepbus_participant import scratch_folder
from stepbus_plant.meshes import binary_stl
from stepbus_schemas import WiringError

_READS = (".stl", ".obj", ".dae")
_HEADER_BYTES, _TRIANGLE_BYTES = 84, 50


@contextmanager
def readable(urdf: Path) -> Iterator[Path]:
    """Provide a URDF whose meshes PyBullet reads, as a context manager; itself, where it does.

    Raises WiringError for a mesh that cannot be read, and for an MJCF.
    """
    robot = read_robot(urdf)
    if robot.format == "mjcf":
        raise WiringError(f"{urdf}: engine pybullet does not load MJCF; use engine mujoco")
    shapes = [s for link in robot.links.values() for s in (*link.visuals, *link.collisions)]
    unread = sorted({s.mesh for s in shapes if s.kind == "mesh" and not _is_read(Path(s.mesh))})
    if not unread:
        yield urdf
        return
    with tempfile.TemporaryDirectory(prefix="stepbus-stl-", dir=scratch_folder()) as folder:
        copies = {file: Path(folder) / f"{number}.stl" for number, file in enumerate(unread)}
        for file, copy in copies.items():
            copy.write_bytes(binary_stl(file))
        links = {
            name: replace(
                link,
                visuals=_with(copies, link.visuals),
                collisions=_with(copies, link.collisions),
            )
            for name, link in robot.links.items()
        }
        model = Path(folder) / urdf.name
        model.write_text(urdf_text(replace(robot, links=links)), encoding="utf-8")
        yield model


def _with(copies: Mapping[str, Path], shapes: tuple[Shape, ...]) -> tuple[Shape, ...]:
    """Return shapes with the copies of their meshes."""
    return tuple(replace(s, mesh=str(copies.get(s.mesh, s.mesh))) for s in shapes)


def _is_read(path: Path) -> bool:
    """Return whether PyBullet reads a file; a binary STL may begin with `solid`, too."""
    if path.suffix.lower() != ".stl":
        return path.suffix.lower() in _READS
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES)
    count = int.from_bytes(head[-4:], "little")
    is_binary = path.stat().st_size == _HEADER_BYTES + _TRIANGLE_BYTES * count
    return is_binary or not head.lstrip().startswith(b"solid")
