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
from stepbus_plant.meshes import binary_stl, is_text_stl

_READS = (".stl", ".obj", ".dae")


@contextmanager
def readable(urdf: Path) -> Iterator[Path]:
    """Provide a URDF whose meshes PyBullet reads, as a context manager; itself, where it does.

    Raises WiringError for a mesh that cannot be read.
    """
    robot = read_robot(urdf)
    shapes = (s for link in robot.links.values() for s in (*link.visuals, *link.collisions))
    meshes = {shape.mesh for shape in shapes if shape.kind == "mesh"}
    paths = {file: Path(file) for file in meshes}
    unread = sorted(f for f, p in paths.items() if p.suffix.lower() not in _READS or is_text_stl(p))
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
