"""Spirals of the tip."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from stepbus_kinematics import Vector

from .tip_path import EVERY_M, TipPose


@dataclass(frozen=True, kw_only=True)
class SpiralCurve:
    """A spiral around a vertical, from one radius to another, gaining height evenly.

    centre: x, y, z in the robot's base; z is the height of its start [m]. radius: at its start
    and its end [m]. turns: counter-clockwise, below 0: clockwise. rise: [m]. starts_at: angle of
    its first point [rad]. rotation: of the tip, shape (3, 3). raised: height added at each of its
    points, shape (k,) [m]; between two points the height blends smoothly.
    """

    centre: Vector
    radius: tuple[float, float]
    turns: float
    rise: float
    starts_at: float
    rotation: Vector
    raised: Vector

    def at(self, share: float) -> tuple[Any, Vector]:
        """Return the pose at a share of the angle, and the velocity by that share, shape (3,)."""
        sweep = 2 * math.pi * self.turns
        widening = self.radius[1] - self.radius[0]
        radius = self.radius[0] + share * widening
        angle = self.starts_at + share * sweep
        cos, sin = math.cos(angle), math.sin(angle)
        lift, lifting = self._lift(share)
        x, y, z = self.centre
        point = np.array([x + radius * cos, y + radius * sin, z + share * self.rise + lift])
        velocity = np.array(
            [
                widening * cos - radius * sweep * sin,
                widening * sin + radius * sweep * cos,
                self.rise + lifting,
            ]
        )
        return pin.SE3(self.rotation, point), velocity

    def _lift(self, share: float) -> tuple[float, float]:
        """Return the height that is added, and its derivative by the share."""
        gaps = len(self.raised) - 1
        gap = min(int(share * gaps), gaps - 1)
        x = share * gaps - gap
        low, high = float(self.raised[gap]), float(self.raised[gap + 1])
        blend = x**3 * (10 - 15 * x + 6 * x * x)
        slope = 30 * (x * (1 - x)) ** 2 * gaps
        return low + (high - low) * blend, (high - low) * slope

    def poses(self) -> list[TipPose]:
        """Return the path over its length, by Simpson's rule."""
        coarse = max(self.radius) * 2 * math.pi * abs(self.turns) + abs(self.rise)
        coarse += float(np.abs(np.diff(self.raised)).sum()) + abs(self.radius[1] - self.radius[0])
        # A whole number of poses between two points, so that no blend is cut in two.
        gaps = len(self.raised) - 1
        count = gaps * max(math.ceil(coarse / EVERY_M / gaps), 2)
        shares = [i / count for i in range(count + 1)]
        rows = [self.at(share) for share in shares]
        speeds = [float(np.linalg.norm(velocity)) for _, velocity in rows]
        halves = [float(np.linalg.norm(self.at((i + 0.5) / count)[1])) for i in range(count)]
        poses, u = [], 0.0
        for i, (pose, velocity) in enumerate(rows):
            twist = np.concatenate([velocity / speeds[i], np.zeros(3)])
            poses.append(TipPose(u=u, pose=pose, twist=twist))
            if i < count:
                u += (speeds[i] + 4 * halves[i] + speeds[i + 1]) / (6 * count)
        return poses
