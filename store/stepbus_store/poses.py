"""Poses that several services read: their check, and their angles."""

import math
from collections.abc import Sequence

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


def wrapped(angle: float) -> float:
    """Return the same angle between -π and π [rad]."""
    return math.remainder(angle, 2 * math.pi)
