"""Meshes that PyBullet does not read, written so that it does.

It takes an STL written as text for a mesh without triangles, and says so in a line of its own: the
link has no shape, and a camera does not see it (3.2.7).
"""

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from stepbus_participant import scratch_folder
from stepbus_plant.models import mesh_path
from stepbus_schemas import WiringError

_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")
_HEADER_BYTES, _TRIANGLE_BYTES = 84, 50
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attribute", "<u2")])


@contextmanager
def readable(urdf: Path) -> Iterator[Path]:
    """Provide a URDF whose meshes PyBullet reads, as a context manager; itself, where it does.

    Raises WiringError for an STL without whole triangles.
    """
    root = ET.parse(urdf).getroot()  # noqa: S314  the file is the user's own
    paths = {
        mesh: Path(mesh_path(mesh.get("filename", ""), urdf.parent)) for mesh in root.iter("mesh")
    }
    texts = {path: path.read_bytes() for path in set(paths.values()) if _is_text(path)}
    if not texts:
        yield urdf
        return
    with tempfile.TemporaryDirectory(prefix="stepbus-stl-", dir=scratch_folder()) as folder:
        for number, (path, text) in enumerate(sorted(texts.items())):
            copy = Path(folder) / f"{number}.stl"
            copy.write_bytes(_binary(path, text))
            paths |= {mesh: copy for mesh, named in paths.items() if named == path}
        for mesh, path in paths.items():
            mesh.set("filename", str(path))
        model = Path(folder) / urdf.name
        ET.ElementTree(root).write(model, encoding="utf-8")
        yield model


def _is_text(path: Path) -> bool:
    """Return whether a file is an STL written as text: binary ones may begin with `solid`, too."""
    if path.suffix.lower() != ".stl" or not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES)
    count = int.from_bytes(head[-4:], "little")
    is_binary = path.stat().st_size == _HEADER_BYTES + _TRIANGLE_BYTES * count
    return head.lstrip().startswith(b"solid") and not is_binary


def _binary(path: Path, text: bytes) -> bytes:
    try:
        vertices = np.array(_VERTEX.findall(text), dtype="<f4").reshape(-1, 3, 3)
    except ValueError as exc:
        raise WiringError(f"{path}: is no STL: its triangles are incomplete ({exc})") from exc
    triangles = np.zeros(len(vertices), dtype=_TRIANGLE)
    triangles["vertices"] = vertices
    return bytes(_HEADER_BYTES - 4) + len(triangles).to_bytes(4, "little") + triangles.tobytes()
