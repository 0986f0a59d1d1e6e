"""Where the base is: odometry, corrected by landmarks, with an extended Kalman filter."""

import math
from collections.abc import Sequence

import numpy as np

from stepbus_kinematics import Vector
from stepbus_schemas import BaseState
from stepbus_store.world_model.params import Params

_GATE = 13.8
"""Squared Mahalanobis distance that 99.9 % of the right landmarks stay below (χ², two degrees)."""

_DOUBT = 2.0
"""Factor on all deviations where no landmark is where it is expected."""

_MOST = 0.15
"""Deviation above which doubt does not grow [m, rad]."""


class Localization:
    """Estimates x, y, yaw of a base on a map [m, rad].

    landmarks: on the map, shape (m, 2) [m]. All look alike: a detection is taken for the one that
    it is nearest to. start: x, y, yaw at the first odometry. After Thrun, Burgard, Fox:
    Probabilistic Robotics, 2005, section 7.4; the motion comes from odometry instead of commands,
    as in its section 5.4.
    """

    def __init__(
        self,
        landmarks: Vector,
        params: Params,
        start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self._landmarks = landmarks
        self._params = params
        self._pose: Vector = np.array(start)
        self._covariance: Vector = params.start**2 * np.eye(3)
        self._odometry: BaseState | None = None

    @property
    def pose(self) -> tuple[float, float, float]:
        """Return x, y, yaw on the map [m, rad]."""
        x, y, yaw = self._pose.tolist()
        return x, y, yaw

    @property
    def deviation(self) -> Vector:
        """Return the standard deviations of x, y, yaw, shape (3,) [m, rad]."""
        deviation: Vector = np.sqrt(np.diag(self._covariance))
        return deviation

    def predict(self, odometry: BaseState) -> None:
        """Move on as odometry has since the last time; the first one is that of the start."""
        before, self._odometry = self._odometry, odometry
        if before is None:
            return
        dx, dy = odometry.x - before.x, odometry.y - before.y
        c, s = math.cos(before.yaw), math.sin(before.yaw)
        ahead, left, turn = c * dx + s * dy, c * dy - s * dx, odometry.yaw - before.yaw
        if ahead == left == turn == 0.0:
            return
        c, s = math.cos(self._pose[2]), math.sin(self._pose[2])
        moved = np.array([c * ahead - s * left, s * ahead + c * left, turn])
        self._pose = self._pose + moved
        slope = np.eye(3)
        slope[:2, 2] = -moved[1], moved[0]
        by, distance = self._params.drift, math.hypot(ahead, left)
        position = by.distance**2 * distance
        heading = by.heading**2 * distance + by.turn**2 * abs(turn)
        noise = np.diag([position, position, heading])
        self._covariance = slope @ self._covariance @ slope.T + noise

    def correct(self, seen: Sequence[tuple[float, float]]) -> int:
        """Correct the pose by landmarks seen in the frame of the base [m]; return how many fit.

        Where none does, the filter has been too sure of itself, and becomes less so.
        """
        pairs = [
            (point, number)
            for point in seen
            if (number := self._associate(np.array(point))) is not None
        ]
        for point, number in pairs:
            self._update(np.array(point), number)
        if seen and not pairs and float(self.deviation.max()) < _MOST:
            self._covariance = _DOUBT**2 * self._covariance
        return len(pairs)

    def _expected(self, number: int) -> tuple[Vector, Vector]:
        """Return where a landmark is in the frame of the base, and the slope by the pose."""
        x, y, yaw = self._pose
        c, s = math.cos(yaw), math.sin(yaw)
        dx, dy = self._landmarks[number] - (x, y)
        ahead, left = c * dx + s * dy, c * dy - s * dx
        return np.array([ahead, left]), np.array([[-c, -s, left], [s, -c, -ahead]])

    def _spread(self, slope: Vector) -> Vector:
        noise: Vector = self._params.landmark_noise**2 * np.eye(2)
        return slope @ self._covariance @ slope.T + noise

    def _associate(self, point: Vector) -> int | None:
        """Return the landmark that a detection is nearest to; None: it is none of them."""
        rows = []
        for number in range(len(self._landmarks)):
            expected, slope = self._expected(number)
            off = point - expected
            if np.hypot(*off) < self._params.farthest:
                rows.append((float(off @ np.linalg.solve(self._spread(slope), off)), number))
        distance, number = min(rows, default=(math.inf, -1))
        return number if distance < _GATE else None

    def _update(self, point: Vector, number: int) -> None:
        expected, slope = self._expected(number)
        gain = np.linalg.solve(self._spread(slope), slope @ self._covariance).T
        self._pose = self._pose + gain @ (point - expected)
        rest = np.eye(3) - gain @ slope
        # Joseph's form stays symmetric and positive whatever is rounded.
        noise = self._params.landmark_noise**2
        self._covariance = rest @ self._covariance @ rest.T + noise * gain @ gain.T
