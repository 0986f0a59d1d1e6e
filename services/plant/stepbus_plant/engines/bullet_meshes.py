"""Meshes that PyBullet does not read, written so that it does (3.2.7).

It takes an STL written as text for a mesh without triangles: the link has no shape, and a camera
does not see it. Of a file that is no STL, OBJ or DAE, it says that the URDF cannot be loaded.
"""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree as ET

from stepbus_participant import scratch_folder
from stepbus_plant.meshes import binary_stl, is_text_stl
from stepbus_plant.models import mesh_path

_READS = (".stl", ".obj", ".dae")


@contextmanager
def readable(urdf: Path) -> Iterator[Path]:
    """Provide a URDF whose meshes PyBullet reads, as a context manager; itself, where it does.

    Raises WiringError for a mesh that cannot be read.
    """
    root = ET.parse(urdf).getroot()  # noqa: S314  the file is the user's own
    files = {m: mesh_path(m.get("filename", ""), urdf.parent) for m in root.iter("mesh")}
    paths = {file: Path(file) for file in files.values()}
    unread = sorted(f for f, p in paths.items() if p.suffix.lower() not in _READS or is_text_stl(p))
    if not unread:
        yield urdf
        return
    with tempfile.TemporaryDirectory(prefix="stepbus-stl-", dir=scratch_folder()) as folder:
        copies = {file: Path(folder) / f"{number}.stl" for number, file in enumerate(unread)}
        for file, copy in copies.items():
            copy.write_bytes(binary_stl(file))
        for mesh, file in files.items():
            mesh.set("filename", str(copies.get(file, file)))
        model = Path(folder) / urdf.name
        ET.ElementTree(root).write(model, encoding="utf-8")
        yield model
