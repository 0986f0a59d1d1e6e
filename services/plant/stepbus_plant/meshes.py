"""Triangles of mesh files, and STL files of them."""

import re
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from stepbus_models import mesh_unit
from stepbus_participant import scratch_folder
from stepbus_plant.geometry import Array
from stepbus_schemas import WiringError

_BARE_POINT = re.compile(rb"(?<![\w.])([+-]?)\.(?=\d)")
"""Of a number such as `.5`, which coal's reader of OBJ files drops with its vertex (3.0.3)."""
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER_BYTES, _COUNT_BYTES = 80, 4


def load_mesh(file: str) -> tuple[Array, Any]:
    """Return vertices, shape (n, 3), and faces, shape (m, 3), of an STL, OBJ, DAE, PLY or glTF.

    Raises WiringError for a file that is none of these.
    """
    state = Path(file).stat()
    return _loaded(file, (state.st_mtime_ns, state.st_size))


@cache
def _loaded(file: str, _state: tuple[int, int]) -> tuple[Array, Any]:
    path = Path(file)
    text = path.read_bytes() if path.suffix.lower() == ".obj" else b""
    if not _BARE_POINT.search(text):
        return _read(file, file)
    with tempfile.TemporaryDirectory(prefix="stepbus-obj-", dir=scratch_folder()) as folder:
        copy = Path(folder) / path.name
        copy.write_bytes(_BARE_POINT.sub(rb"\g<1>0.", text))
        return _read(str(copy), file)


def _read(file: str, named: str) -> tuple[Array, Any]:
    """Return the triangles of a file; named: in messages."""
    import coal  # noqa: PLC0415  only models with meshes need it

    try:
        loaded = coal.MeshLoader().load(file, np.full(3, mesh_unit(file)))
    except (RuntimeError, ValueError, OSError) as exc:
        text = str(exc).partition("message:")[2] or str(exc)
        reason = text.strip().splitlines()[0].replace(file, named)
        raise WiringError(f"cannot read {named}: {reason}") from exc
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
    triangles["vertices"] = vertices[faces]
    return bytes(_HEADER_BYTES) + len(faces).to_bytes(_COUNT_BYTES, "little") + triangles.tobytes()
