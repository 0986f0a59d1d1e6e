"""Rotations and poses in space."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Pose:
    """The pose of a frame in another one.

    rotation: shape (3, 3), its axes as columns. position: shape (3,) [m].
    """

    rotation: Vector
    position: Vector


def rotation(quaternion: Sequence[float]) -> Vector:
    """Return the matrix, shape (3, 3), of a quaternion x, y, z, w of any length but 0."""
    x, y, z, w = np.asarray(quaternion) / math.hypot(*quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def inverse_times(one: Sequence[float], other: Sequence[float]) -> Quaternion:
    """Return conj(one)·other, the orientation of `other` in `one`; quaternions x, y, z, w."""
    ax, ay, az, aw = -one[0], -one[1], -one[2], one[3]
    bx, by, bz, bw = other
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def turn_about_z(yaw: float) -> Quaternion:
    """Return the quaternion x, y, z, w of a rotation about z [rad]."""
    return (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
