"""Shows targets only where they differ from what is measured: the same place twice flickers."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from stepbus_tools.viewing.scene import GHOST, Pose

_APART_M = 0.01
_APART_RAD = math.radians(1.0)
_STICKS = 0.5
"""A ghost that is shown stays until it is so much nearer."""


class Ghosts:
    """Ghosts of links. meshes: frame of a ghost → what it is drawn with."""

    def __init__(self, meshes: Mapping[str, Sequence[Any]]) -> None:
        self._meshes = meshes
        self._apart: set[str] = set(meshes)
        self._visible = True

    def __bool__(self) -> bool:
        """Return whether there are any."""
        return bool(self._meshes)

    def show(self, *, visible: bool) -> None:
        """Show those that differ from what is measured, or none."""
        self._visible = visible
        for name in self._meshes:
            self._apply(name)

    def compare(self, poses: Mapping[str, Pose]) -> None:
        """Show ghosts that have gone, hide those that have arrived. poses: in the world."""
        for name in self._meshes:
            actual = poses.get(name.removeprefix(f"{GHOST}/"))
            is_apart = actual is None or _apart(poses[name], actual) > (
                _STICKS if name in self._apart else 1.0
            )
            if is_apart != (name in self._apart):
                self._apart ^= {name}
                self._apply(name)

    def _apply(self, name: str) -> None:
        for mesh in self._meshes[name]:
            mesh.visible = self._visible and name in self._apart


def _apart(a: Pose, b: Pose) -> float:
    """Return how far two poses are apart; 1 is where an eye sees it."""
    cosine = min(1.0, abs(sum(x * y for x, y in zip(a.wxyz, b.wxyz, strict=True))))
    return max(math.dist(a.position, b.position) / _APART_M, 2 * math.acos(cosine) / _APART_RAD)
