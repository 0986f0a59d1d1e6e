"""What all functions of scripts share: the numbers of CoppeliaSim, and its angles and matrices."""

import math
from collections.abc import Mapping
from importlib import resources
from typing import TYPE_CHECKING, ClassVar

from stepbus_coppelia.clients import ApiError
from stepbus_plant.geometry import Pose, product, quaternion, rotation
from stepbus_schemas import Point, Quaternion

if TYPE_CHECKING:
    from stepbus_coppelia.session import Session


class Group:
    """Functions of one kind, by the names that scripts call them by, without `sim.`.

    title: in the documentation. also: further names of functions. sim: the session.
    """

    title: ClassVar[str]
    also: ClassVar[Mapping[str, str]] = {}

    def __init__(self, sim: "Session") -> None:
        self.sim = sim

    @classmethod
    def names(cls) -> dict[str, str]:
        """Return each name of a function, further ones included → the method that does it."""
        own = [name for name in vars(cls) if name[0] != "_" and name not in ("title", "also")]
        return dict(zip(own, own, strict=True)) | dict(cls.also)


_NUMBERS = resources.files("stepbus_coppelia").joinpath("constants.txt").read_text()
CONSTANTS = {word.split("=")[0]: int(word.split("=")[1]) for word in _NUMBERS.split()}
"""CoppeliaSim's numbers, by name without `sim.`."""


def number(value: object) -> float:
    """Return a finite number that a script has given; raises ApiError."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ApiError(f"{value!r} is not a finite number.")
    return float(value)


def numbers(values: object, *counts: int) -> list[float]:
    """Return a list of finite numbers, of one of some lengths; raises ApiError."""
    if not isinstance(values, list | tuple) or (counts and len(values) not in counts):
        sizes = " or ".join(map(str, counts)) or "some"
        raise ApiError(f"expected a list of {sizes} numbers, not {values!r}.")
    return [number(value) for value in values]


def euler(turn: Quaternion) -> list[float]:
    """Return alpha, beta and gamma [rad]: turns about x, then the new y, then the new z."""
    m = rotation(turn)
    beta = math.asin(min(max(m[0, 2], -1.0), 1.0))
    if abs(m[0, 2]) > 1.0 - 1e-12:
        return [0.0, beta, math.atan2(m[1, 0], m[1, 1])]
    return [math.atan2(-m[1, 2], m[2, 2]), beta, math.atan2(-m[0, 1], m[0, 0])]


def of_euler(angles: list[float]) -> Quaternion:
    """Return the orientation of alpha, beta and gamma [rad]."""
    a, b, c = angles
    return product(product(quaternion((a, 0, 0)), quaternion((0, b, 0))), quaternion((0, 0, c)))


def point(values: object) -> Point:
    """Return a point; raises ApiError."""
    x, y, z = numbers(values, 3)
    return x, y, z


def turn_of(values: list[float]) -> Quaternion:
    """Return a quaternion x, y, z, w of length 1; raises ApiError for zeros."""
    length = math.sqrt(sum(value * value for value in values))
    if length < 1e-9:
        raise ApiError("a quaternion of zeros is no orientation.")
    x, y, z, w = (value / length for value in values)
    return x, y, z, w


def pose_of(values: object) -> Pose:
    """Return the pose of x, y, z, qx, qy, qz, qw; raises ApiError."""
    row = numbers(values, 7)
    return (row[0], row[1], row[2]), turn_of(row[3:])


def matrix(pose: Pose) -> list[float]:
    """Return a pose as the first three rows of its matrix, 12 numbers."""
    m, p = rotation(pose[1]), pose[0]
    return [value for i in range(3) for value in (*m[i].tolist(), p[i])]


def of_matrix(values: object) -> Pose:
    """Return the pose of a matrix of 12 or 16 numbers, row by row; raises ApiError."""
    m = numbers(values, 12, 16)
    rows = [m[0:3], m[4:7], m[8:11]]
    trace = rows[0][0] + rows[1][1] + rows[2][2]
    # The largest of the four squares keeps the quotients exact.
    squares = [*(1.0 + 2.0 * rows[i][i] - trace for i in range(3)), 1.0 + trace]
    one = max(range(4), key=squares.__getitem__)
    q = [rows[2][1] - rows[1][2], rows[0][2] - rows[2][0], rows[1][0] - rows[0][1], 0.0]
    if one < 3:
        q = [*(rows[one][i] + rows[i][one] for i in range(3)), q[one]]
    q[one] = squares[one]
    return (m[3], m[7], m[11]), turn_of(q)
