"""The check of Poses/1, which mission, perception and planner read."""

import math
from collections.abc import Sequence

from stepbus_schemas import Poses, RunError


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
