"""Triangles of mesh files, and STL files of them."""

from pathlib import Path
from typing import Any

import numpy as np

from stepbus_models import mesh_unit
from stepbus_plant.geometry import Array
from stepbus_schemas import WiringError

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER_BYTES, _COUNT_BYTES = 80, 4


def load_mesh(file: str) -> tuple[Array, Any]:
    """Return vertices [m], shape (n, 3), and faces, shape (m, 3), of an STL, DAE, PLY or glTF.

    Raises WiringError for another file.
    """
    import coal  # noqa: PLC0415  only models with meshes need it

    try:
        loaded = coal.MeshLoader().load(file, np.full(3, mesh_unit(file)))
    except (RuntimeError, ValueError, OSError) as exc:
        text = str(exc).partition("message:")[2] or str(exc)
        raise WiringError(f"cannot read {file}: {text.strip().splitlines()[0]}") from exc
    faces = [
        [triangle[0], triangle[1], triangle[2]]
        for triangle in (loaded.tri_indices(n) for n in range(loaded.num_tris))
    ]
    return np.array(loaded.vertices(), dtype=float), np.array(faces, dtype=int)


def is_text_stl(path: Path) -> bool:
    """Return whether a file is an STL written as text; a binary one may begin with `solid`, too."""
    if path.suffix.lower() != ".stl":
        return False
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES + _COUNT_BYTES)
    count = int.from_bytes(head[_HEADER_BYTES:], "little")
    is_binary = path.stat().st_size == len(head) + _TRIANGLE.itemsize * count
    return not is_binary and head.lstrip().startswith(b"solid")


def binary_stl(file: str) -> bytes:
    """Return the triangles of a mesh file as a binary STL; raises as `load_mesh`."""
    vertices, faces = load_mesh(file)
    triangles = np.zeros(len(faces), dtype=_TRIANGLE)
    corners = vertices[faces]
    triangles["vertices"] = corners
    # TinyRenderer draws what has none in black.
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    triangles["normal"] = normals / np.where(lengths, lengths, 1.0)
    return bytes(_HEADER_BYTES) + len(faces).to_bytes(_COUNT_BYTES, "little") + triangles.tobytes()
