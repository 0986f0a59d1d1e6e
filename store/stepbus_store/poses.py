"""Poses that several services read: their check, and their orientations as other numbers."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stepbus_schemas import Poses, Quaternion, RunError


def check_poses(port: str, links: Sequence[str], poses: Poses) -> None:
    """Raise RunError for a wrong number of poses, and for an invalid one; port: for messages."""
    counts = (len(poses.position), len(poses.orientation))
    if set(counts) != {len(links)}:
        received = f"{counts[0]} positions and {counts[1]} orientations"
        raise RunError(f"input {port!r}: expected {len(links)} poses, received {received}")
    for link, position, turn in zip(links, poses.position, poses.orientation, strict=True):
        if not (math.isfinite(sum(position)) and 0.0 < math.hypot(*turn) < math.inf):
            text = f"{link} has an invalid pose: position {position}, orientation {turn}"
            raise RunError(f"input {port!r}: {text}")


def yaw_of(q: Quaternion) -> float:
    """Return the yaw of an orientation [rad]; 0 for a quaternion of zeros."""
    x, y, z, w = q
    return math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)


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
