"""Paths of the joints over a parameter."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stepbus_kinematics import Vector
from stepbus_store.motion.goals.outcome import Refused


@dataclass(frozen=True, kw_only=True)
class JointPath:
    """Cubic Hermite interpolation of joint positions over a parameter u.

    u: shape (k,), increasing. q: shape (k, n) [rad]. slope: dq/du, shape (k, n).
    """

    u: Vector
    q: Vector
    slope: Vector

    @cached_property
    def _ends(self) -> Vector:
        """Return the ends and the tangents of each piece, shape (k - 1, 4, n)."""
        widths = np.diff(self.u)[:, np.newaxis]
        tangents = (widths * self.slope[:-1], widths * self.slope[1:])
        return np.stack([self.q[:-1], self.q[1:], *tangents], axis=1)

    def at(self, u: float) -> tuple[Vector, Vector, Vector]:
        """Return q, dq/du and d²q/du² at u, each of shape (n,); u is clipped to the path."""
        piece = int(np.searchsorted(self.u, u, side="right")) - 1
        piece = min(max(piece, 0), len(self.u) - 2)
        width = float(self.u[piece + 1] - self.u[piece])
        x = min(max((u - float(self.u[piece])) / width, 0.0), 1.0)
        one, two = 6 * x * (x - 1) / width, (12 * x - 6) / width**2
        blend = np.array(
            [
                [1 + x * x * (2 * x - 3), x * x * (3 - 2 * x), x * (1 - x) ** 2, x * x * (x - 1)],
                [one, -one, (1 + x * (3 * x - 4)) / width, x * (3 * x - 2) / width],
                [two, -two, (6 * x - 4) / width**2, (6 * x - 2) / width**2],
            ]
        )
        q, slope, curve = blend @ self._ends[piece]
        return q, slope, curve


def joint_path(points: Sequence[Vector]) -> JointPath:
    """Return a smooth path through joint positions, each of shape (n,), over their distance [rad].

    The slopes are those of Catmull and Rom; points closer than 1e-9 rad to the one before are left
    out. Raises Refused where fewer than two are left.
    """
    kept: list[Vector] = []
    for point in points:
        if not kept or float(np.linalg.norm(point - kept[-1])) > 1e-9:
            kept.append(point)
    if len(kept) < 2:
        raise Refused("no_path", "the path has no length: the arm is there already")
    q = np.array(kept)
    u = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])
    return JointPath(u=u, q=q, slope=np.gradient(q, u, axis=0))
