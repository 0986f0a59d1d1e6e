"""The upright and tilted solids that an item consists of, as Poses/1 describes them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepbus_schemas import Shape, parse_shapes

Vector = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Solid:
    """A box, cylinder or sphere in the frame of its link.

    half: half its extents along its own axes [m]. axes: shape (3, 3), as columns. position: of its
    centre, shape (3,) [m].
    """

    type: str
    half: tuple[float, float, float]
    axes: Vector
    position: Vector

    @property
    def reach(self) -> Vector:
        """Return half the extents of its bounding box in the link's frame, shape (3,) [m]."""
        reach: Vector = np.abs(self.axes) @ self.half
        return reach


def read_solids(text: str) -> list[Solid]:
    """Return the solids of a description; meshes do not count.

    Raises ValueError for a text that cannot be read, and for other shapes.
    """
    return [_solid(shape) for shape in parse_shapes(text) if shape.type != "mesh"]


def _solid(shape: Shape) -> Solid:
    match shape.type, shape.sizes:
        case "box", (x, y, z):
            half = (x / 2, y / 2, z / 2)
        case "cylinder", (radius, length):
            half = (radius, radius, length / 2)
        case "sphere", (radius,):
            half = (radius, radius, radius)
        case _:
            raise ValueError(
                f"shape {shape.type!r} is not supported; use a box, cylinder, sphere or mesh"
            )
    axes, position = rotation(shape.orientation), np.array(shape.position)
    return Solid(type=shape.type, half=half, axes=axes, position=position)


def rotation(quaternion: Sequence[float]) -> NDArray[np.float64]:
    """Return the matrix, shape (3, 3), of a quaternion x, y, z, w of any length but 0."""
    x, y, z, w = np.asarray(quaternion) / math.hypot(*quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
