"""Weighs what a gripper holds, from the torques of the arm."""

import math

import numpy as np

from stepbus_kinematics import RobotModel, Vector

_SLOW = 0.3
"""Velocity up to which the torques of an arm are those of its weight [rad/s]."""

_SETTLES_IN = 0.15
"""Time constant of the mean, which evens out how the motors settle [s]."""

_LEAST_LEVER = 0.2
"""Torques per mass below which a pose tells nothing about a load [m]."""

_GRAVITY = 9.81
"""[m/s²]"""

_RESOLUTION = 0.01
"""[kg]"""


class Scale:
    """Weighs a point mass at a frame of the robot, whenever the arm is slow.

    The mass is the one with which gravity explains the measured torques best.
    """

    def __init__(self, robot: RobotModel, frame: str) -> None:
        self._robot = robot
        self._number = robot.frame_id(frame)
        self._mean = 0.0
        self.load = 0.0
        """Mass of what the gripper holds, as far as it is known [kg]."""

    def clear(self) -> None:
        """Forget the load: the gripper holds nothing."""
        self._mean = self.load = 0.0

    def weigh(self, q: Vector, v: Vector, effort: Vector, dt: float) -> float:
        """Return the mass by what was measured dt after the last time [kg].

        q, v, effort: of the joints, shape (n,) [rad, rad/s, N·m].
        """
        _, jacobian = self._robot.jacobian(q, self._number)
        lever = jacobian[2]
        size = float(lever @ lever)
        if float(np.abs(v).max()) <= _SLOW and size >= _LEAST_LEVER**2:
            excess = effort - self._robot.gravity_torque(q)
            mass = self._robot.load + float(lever @ excess) / (size * _GRAVITY)
            self._mean += (mass - self._mean) * (1.0 - math.exp(-dt / _SETTLES_IN))
        if abs(self._mean - self.load) > _RESOLUTION:
            self.load = max(round(self._mean / _RESOLUTION) * _RESOLUTION, 0.0)
        return self.load
