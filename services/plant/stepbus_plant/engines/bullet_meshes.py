"""Robots as PyBullet reads them (3.2.7): URDF, with meshes of its formats.

It takes an STL written as text for a mesh without triangles: the link has no shape, and a camera
does not see it. Of a file that is no STL, OBJ or DAE, it says that the URDF cannot be loaded.
"""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stepbus_models import RobotDescription, urdf_text
from stepbus_participant import scratch_folder
from stepbus_plant.meshes import binary_stl, is_text_stl

_READS = (".stl", ".obj", ".dae")


@contextmanager
def written(robot: RobotDescription) -> Iterator[Path]:
    """Provide the file of a robot that PyBullet reads, as a context manager.

    Raises WiringError for a mesh that cannot be read.
    """
    shapes = (s for link in robot.links.values() for s in (*link.visuals, *link.collisions))
    meshes = {shape.mesh: Path(shape.mesh) for shape in shapes if shape.kind == "mesh"}
    with tempfile.TemporaryDirectory(prefix="stepbus-urdf-", dir=scratch_folder()) as folder:
        copies: dict[str, Path] = {}
        for file, path in meshes.items():
            if path.suffix.lower() not in _READS or is_text_stl(path):
                copies[file] = Path(folder) / f"{len(copies)}.stl"
                copies[file].write_bytes(binary_stl(file))
        urdf = Path(folder) / "robot.urdf"
        urdf.write_bytes(urdf_text(robot, meshes=copies).encode())
        yield urdf
