"""Mesh files of robots."""

import re
from pathlib import Path

_UNIT = re.compile(rb"""<unit\b[^>]*?\bmeter\s*=\s*["']\s*([^"'\s]+)""")


def mesh_unit(file: str) -> float:
    """Return the length of the unit of a Collada file [m]; 1 for a file of another format.

    PyBullet scales meshes by it; coal, which reads them for Pinocchio, does not (3.0.3).
    """
    found = _UNIT.search(Path(file).read_bytes()) if file.lower().endswith(".dae") else None
    return float(found[1]) if found else 1.0
