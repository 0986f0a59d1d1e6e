"""How the gripper may come to an item: one approach after the other."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Approach:
    """One approach; text: a phrase about it.

    turn: of the gripper about the vertical [rad]. farther: height above the usual one [m]. slack:
    how much wider than the item the gripper opens; None: as wide as usual [m]. is_straight: down in
    a straight line; else along a planned path.
    """

    text: str
    turn: float = 0.0
    farther: float = 0.0
    slack: float | None = None
    is_straight: bool = True


_QUARTER = math.pi / 2
_NARROW = 0.02
"""Room between an item and the pads of a gripper that opens no wider than it has to [m]."""

APPROACHES = (
    Approach(text="straight down"),
    Approach(text="with the gripper turned by 90°", turn=_QUARTER),
    Approach(text="with the gripper turned by -90°", turn=-_QUARTER),
    Approach(text="with the gripper turned by 180°, from farther", turn=math.pi, farther=0.1),
    Approach(text="along a planned path", is_straight=False),
    Approach(text="turned by 90°, along a planned path", turn=_QUARTER, is_straight=False),
    Approach(text="opened less", slack=_NARROW),
    Approach(text="turned by 90°, opened less", turn=_QUARTER, slack=_NARROW),
)
"""In this order; another attempt takes the next one."""
