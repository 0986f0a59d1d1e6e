"""An arm beside a base that moves."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stepbus_kinematics import Vector
from stepbus_schemas import Point
from stepbus_store.motion.manipulator.candidates import Candidate

_FARTHER = 1.5
"""By how much farther than the nearest solution the arm goes beside a base that drives [rad]."""


@dataclass(frozen=True, kw_only=True)
class Beside:
    """The base moves beside the arm: bases are its poses at which the path of the arm is checked.

    waits: the arm moves only once it is released.
    """

    bases: Sequence[Point] = ()
    waits: bool = False


def about_as_near(candidates: Iterator[Candidate], rest: Vector) -> Iterator[Candidate]:
    """Yield candidates that are little farther from rest than the first one, shape (n,) [rad]."""
    nearest: float | None = None
    for candidate in candidates:
        away = float(np.linalg.norm(candidate.target - rest))
        nearest = away if nearest is None else nearest
        if away > nearest + _FARTHER:
            return
        yield candidate
