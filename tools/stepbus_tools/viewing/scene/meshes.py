"""What a frame looks like: meshes of files and of primitives."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_participant import need

from .pose import Pose

Color = tuple[int, int, int]
"""Red, green, blue, 0 to 255."""
GREY: Color = (176, 178, 184)

_SEGMENTS = 24
_RINGS = 12
_MOST_FACES = 4000
_CELLS = 64


@dataclass(frozen=True)
class Mesh:
    """Triangles of one colour. vertices: shape (n, 3) [m]. faces: shape (m, 3)."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]
    color: Color | None = None


@dataclass(frozen=True, kw_only=True)
class Visual:
    """A mesh at a place in its frame. color: of the mesh where that has none of its own."""

    mesh: Mesh
    pose: Pose = field(default_factory=Pose)
    color: Color = GREY

    @property
    def shown_color(self) -> Color:
        """Return the colour to draw."""
        return self.mesh.color or self.color


@lru_cache(maxsize=512)
def primitive(shape: str, size: tuple[float, ...]) -> Mesh | None:
    """Return a box (x, y, z), capsule or cylinder (radius, length) or sphere (radius) [m].

    None for any other shape or size.
    """
    match shape, size:
        case "box", (_, _, _):
            return _box(size)
        case "cylinder", (radius, length):
            half = length / 2
            return _turned([(0.0, -half), (radius, -half), (radius, half), (0.0, half)])
        case "capsule", (radius, length):
            return _round(radius, length / 2)
        case "sphere", (radius,):
            return _round(radius, 0.0)
    return None


def _box(size: tuple[float, ...]) -> Mesh:
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [(a, *pair) for a, b, c, d in sides for pair in ((b, c), (c, d))]
    return Mesh((signs * np.array(size) / 2).astype(np.float32), np.array(faces, np.uint32))


def _round(radius: float, half: float) -> Mesh:
    """Return two halves of a sphere, so far above and below the middle [m]."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, _RINGS + 2)
    rows = [(radius * np.cos(a), radius * np.sin(a) + np.copysign(half, a)) for a in angles]
    rows[0], rows[-1] = (0.0, rows[0][1]), (0.0, rows[-1][1])
    return _turned([(float(r), float(z)) for r, z in rows])


def _turned(profile: Sequence[tuple[float, float]]) -> Mesh:
    """Return what a line turns into about z. profile: radius and height, from below [m]."""
    angles = np.arange(_SEGMENTS) * (2 * np.pi / _SEGMENTS)
    rows = [(r * np.cos(angles), r * np.sin(angles), np.full(_SEGMENTS, z)) for r, z in profile]
    vertices = np.concatenate([np.stack(row, axis=1) for row in rows])
    here = np.arange(_SEGMENTS)
    then = (here + 1) % _SEGMENTS
    faces = []
    for ring, ((below, _), (above, _)) in enumerate(pairwise(profile)):
        a, b = ring * _SEGMENTS, (ring + 1) * _SEGMENTS
        if below:
            faces.append(np.stack((a + here, a + then, b + then), axis=1))
        if above:
            faces.append(np.stack((a + here, b + then, b + here), axis=1))
    return Mesh(vertices.astype(np.float32), np.concatenate(faces).astype(np.uint32))


PLACEHOLDER = replace(_box((0.08, 0.08, 0.08)), color=GREY)
"""A grey box, which stands for what cannot be shown."""


@lru_cache(maxsize=256)
def mesh_file(path: Path, scale: tuple[float, float, float]) -> tuple[Mesh, ...]:
    """Return the meshes of a file, one of each colour; raises ValueError when it has none.

    Raises ExtraMissing, a WiringError, without trimesh, which takes a second to load.
    """
    (trimesh,) = need("a mesh", "trimesh")
    groups: dict[Color | None, list[Any]] = {}
    try:
        # Textures are not shown, and their files need not be there.
        loaded = trimesh.load(path, skip_materials=path.suffix.lower() == ".obj")
        if path.suffix.lower() == ".dae" and loaded.units:
            loaded = loaded.convert_units("meters")  # a URDF's meshes are in metres, as in PyBullet
        for part in loaded.dump() if isinstance(loaded, trimesh.Scene) else [loaded]:
            if isinstance(part, trimesh.Trimesh) and len(part.faces):
                groups.setdefault(_color_of(part), []).append(part)
        united = [(color, trimesh.util.concatenate(parts)) for color, parts in groups.items()]
    except Exception as exc:
        raise ValueError(f"{path.name} cannot be read: {exc}") from exc
    if not united:
        raise ValueError(f"{path.name} has no triangles")
    return tuple(_mesh(part, color, scale) for color, part in united)


def _color_of(part: Any) -> Color | None:
    """Return the colour of a mesh; None where its file gives it none."""
    visual = part.visual
    if not visual.defined:
        return None
    material = getattr(visual, "material", None)
    color = visual.main_color if material is None else material.main_color
    red, green, blue = (int(value) for value in color[:3])
    return red, green, blue


def _mesh(part: Any, color: Color | None, scale: tuple[float, float, float]) -> Mesh:
    vertices = np.asarray(part.vertices, dtype=np.float32)
    faces = np.asarray(part.faces, dtype=np.uint32)
    if len(faces) > _MOST_FACES:
        vertices, faces = _coarser(vertices, faces)
    return Mesh(vertices * np.array(scale, dtype=np.float32), faces, color)


def _coarser(
    vertices: NDArray[np.float32], faces: NDArray[np.uint32]
) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return triangles without what is smaller than a hundredth of them: a browser draws them.

    Vertices in the same cell of a grid become one, where they are on average.
    """
    size = float(np.ptp(vertices, axis=0).max()) / _CELLS or 1.0
    cells = np.floor((vertices - vertices.min(axis=0)) / size).astype(np.int64)
    keys = (cells * np.array([1, 1024, 1024 * 1024])).sum(axis=1)
    _, number, counts = np.unique(keys, return_inverse=True, return_counts=True)
    sums = [np.bincount(number, weights=vertices[:, axis]) for axis in range(3)]
    middle = (np.stack(sums, axis=1) / counts[:, None]).astype(np.float32)
    kept = number[faces].astype(np.uint32)
    a, b, c = kept.T
    return middle, kept[(a != b) & (b != c) & (a != c)]
