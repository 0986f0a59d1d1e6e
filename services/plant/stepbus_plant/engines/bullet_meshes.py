"""Meshes that PyBullet does not read, written so that it does (3.2.7).

It takes an STL written as text for a mesh without triangles: the link has no shape, and a camera
does not see it. Of a file that is no STL, OBJ or DAE, it says that the URDF cannot be loaded.
"""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stepbus_models import read_robot, urdf_text
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
    shapes = (s for link in robot.links.values() for s in (*link.visuals, *link.collisions))
    meshes = {shape.mesh for shape in shapes if shape.kind == "mesh"}
    unread = sorted(file for file in meshes if not _is_read(Path(file)))
    if not unread:
        yield urdf
        return
    with tempfile.TemporaryDirectory(prefix="stepbus-stl-", dir=scratch_folder()) as folder:
        copies = {file: Path(folder) / f"{number}.stl" for number, file in enumerate(unread)}
        for file, copy in copies.items():
            copy.write_bytes(binary_stl(file))
        model = Path(folder) / urdf.name
        model.write_bytes(urdf_text(robot, meshes=copies).encode())
        yield model


def _is_read(path: Path) -> bool:
    """Return whether PyBullet reads a file; a binary STL may begin with `solid`, too."""
    if path.suffix.lower() != ".stl":
        return path.suffix.lower() in _READS
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES)
    count = int.from_bytes(head[-4:], "little")
    is_binary = path.stat().st_size == _HEADER_BYTES + _TRIANGLE_BYTES * count
    return is_binary or not head.lstrip().startswith(b"solid")
