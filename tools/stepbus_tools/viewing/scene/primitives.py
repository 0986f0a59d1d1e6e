"""The triangles of boxes, capsules, cylinders and spheres."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Triangles = tuple[NDArray[np.float32], NDArray[np.uint32]]
"""Vertices, shape (n, 3) [m], and faces, shape (m, 3), counter-clockwise from outside."""

_SEGMENTS = 24
_RINGS = 12


def _box(size: Sequence[float]) -> Triangles:
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [(a, *pair) for a, b, c, d in sides for pair in ((b, c), (c, d))]
    return (signs * np.array(size) / 2).astype(np.float32), np.array(faces, np.uint32)


def _turned(profile: Sequence[tuple[float, float]]) -> Triangles:
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
    return vertices.astype(np.float32), np.concatenate(faces).astype(np.uint32)


def _cylinder(size: Sequence[float]) -> Triangles:
    radius, half = size[0], size[1] / 2
    return _turned([(0.0, -half), (radius, -half), (radius, half), (0.0, half)])


def _capsule(size: Sequence[float]) -> Triangles:
    radius, half = size[0], size[1] / 2
    angles = np.linspace(-np.pi / 2, np.pi / 2, _RINGS + 2)
    rows = [(radius * np.cos(a), radius * np.sin(a) + np.copysign(half, a)) for a in angles]
    rows[0], rows[-1] = (0.0, rows[0][1]), (0.0, rows[-1][1])
    return _turned([(float(r), float(z)) for r, z in rows])


def _sphere(size: Sequence[float]) -> Triangles:
    return _capsule((size[0], 0.0))


PRIMITIVES: Mapping[str, Callable[[Sequence[float]], Triangles]] = {
    "box": _box,
    "capsule": _capsule,
    "cylinder": _cylinder,
    "sphere": _sphere,
}
"""Shape → what makes it of its sizes: x, y, z; radius, length; radius [m]."""
