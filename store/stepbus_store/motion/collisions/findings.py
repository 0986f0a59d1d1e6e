"""What a monitor of contacts finds in a step."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Collision:
    """A forbidden touch; ours: the robot's link, or what it holds. force: [N]."""

    ours: str
    other: str
    force: float

    @property
    def pair(self) -> tuple[str, str]:
        """Return the names of both links."""
        return self.ours, self.other

    def __str__(self) -> str:
        return self.with_force(self.force)

    def with_force(self, force: float) -> str:
        """Return a sentence with another force [N], such as the largest so far."""
        return f"{self.ours} touches {self.other} with {force:.1f} N"


@dataclass(frozen=True, kw_only=True)
class Approach:
    """Two links that are close; gap: [m]."""

    ours: str
    other: str
    gap: float

    @property
    def pair(self) -> tuple[str, str]:
        """Return the names of both links."""
        return self.ours, self.other

    def __str__(self) -> str:
        return f"{self.ours} is {self.gap * 1e3:.1f} mm from {self.other}"


@dataclass(frozen=True, kw_only=True)
class Watch:
    """What the monitor found in a step.

    collision: the hardest forbidden touch; None: there is none. near: the closest pair that must
    not touch, and `gap` its distance [m]; None: nothing is near. strange: the pairs of which one is
    no link of the robot, and the distance that the hardest stop of the arm would leave, below 0: it
    would not; the least one first. room: for the base, the distance
    to the closest thing, longer for what it passes by [m]. held: link of the world between the
    pads; empty: none. scale: share of the full speed, 0 to 1; slow: the pair that it is for, and
    their distance [m].
    """

    collision: Collision | None
    near: tuple[str, str] | None
    gap: float
    held: str
    scale: float
    room: float = math.inf
    slow: tuple[str, str, float] | None = None
    strange: tuple[tuple[Approach, float], ...] = ()
