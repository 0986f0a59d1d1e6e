"""Poses, to write models of other formats as URDF. They need no NumPy."""

import math
from collections.abc import Sequence
from xml.etree import ElementTree as ET

Matrix = tuple[tuple[float, ...], ...]
"""A rotation, by rows."""


class Pose:
    """A pose: rotation, and translation [m]."""

    def __init__(self, rotation: Matrix, translation: Sequence[float]) -> None:
        self.rotation, self.translation = rotation, tuple(translation)

    def __matmul__(self, other: "Pose") -> "Pose":
        turned = self.turn(other.translation)
        moved = [a + b for a, b in zip(self.translation, turned, strict=True)]
        columns = tuple(zip(*other.rotation, strict=True))
        rows = (tuple(_dot(row, column) for column in columns) for row in self.rotation)
        return Pose(tuple(rows), moved)

    def turn(self, vector: Sequence[float]) -> list[float]:
        """Return a vector, turned."""
        return [_dot(row, vector) for row in self.rotation]

    def inverse(self) -> "Pose":
        """Return the inverse."""
        back = Pose(tuple(zip(*self.rotation, strict=True)), (0.0, 0.0, 0.0))
        return Pose(back.rotation, [-value for value in back.turn(self.translation)])

    def origin(self) -> ET.Element:
        """Return the pose as the <origin> of a URDF."""
        r = self.rotation
        pitch = math.atan2(-r[2][0], math.hypot(r[0][0], r[1][0]))
        yaw = math.atan2(r[1][0], r[0][0])
        # Roll is what is left behind pitch and yaw, also where x points along z and yaw is noise.
        s, c = math.sin(yaw), math.cos(yaw)
        roll = math.atan2(s * r[0][2] - c * r[1][2], c * r[1][1] - s * r[0][1])
        return ET.Element(
            "origin", {"xyz": text_of(self.translation), "rpy": text_of((roll, pitch, yaw))}
        )


IDENTITY = Pose(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), (0.0, 0.0, 0.0))


def shift(translation: Sequence[float]) -> Pose:
    """Return the pose of a translation [m]."""
    return Pose(IDENTITY.rotation, translation)


def pose_of_rpy(translation: Sequence[float], rpy: Sequence[float]) -> Pose:
    """Return a pose from its translation [m] and roll, pitch, yaw about fixed axes [rad]."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(a), math.cos(a)) for a in rpy)
    rotation = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    return Pose(rotation, translation)


def pose_of_wxyz(translation: Sequence[float], quaternion: Sequence[float]) -> Pose:
    """Return a pose from its translation [m] and a quaternion, w first, of any length above 0."""
    length = math.hypot(*quaternion)
    w, x, y, z = (value / length for value in quaternion)
    rotation = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return Pose(rotation, translation)


def turn_about(axis: Sequence[float], angle: float) -> Pose:
    """Return the pose of a turn about an axis of length 1 by an angle [rad]."""
    s = math.sin(angle / 2)
    return pose_of_wxyz((0.0, 0.0, 0.0), (math.cos(angle / 2), *(s * value for value in axis)))


def text_of(values: Sequence[float]) -> str:
    """Return numbers as the attribute of a URDF, to the last bit."""
    return " ".join(repr(float(value)) for value in values)


def _dot(one: Sequence[float], other: Sequence[float]) -> float:
    return sum(a * b for a, b in zip(one, other, strict=True))
