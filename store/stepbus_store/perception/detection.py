"""What is detected: an item that stands, or lies."""

import math
from dataclasses import dataclass

from stepbus_store.perception.images import Quaternion, turn_about_z


@dataclass(frozen=True, kw_only=True)
class Detection:
    """A detected item.

    position: of its centre [m]. yaw: of its link, or where it lies, of its axis [rad]. Both are in
    the frame of the scene. confidence: 0 to 1.
    """

    type: str
    position: tuple[float, float, float]
    yaw: float
    confidence: float
    lies: bool = False

    @property
    def orientation(self) -> Quaternion:
        """Return its orientation, x, y, z, w; where it lies, its axis z is horizontal."""
        if not self.lies:
            return turn_about_z(self.yaw)
        half = math.sqrt(0.5)
        return (-half * math.sin(self.yaw), half * math.cos(self.yaw), 0.0, half)
