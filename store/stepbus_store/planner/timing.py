"""Time parametrization of paths with toppra."""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import toppra
from toppra import algorithm, constraint

from stepbus_kinematics import Vector

logging.getLogger("toppra").setLevel(logging.CRITICAL)

_DENSE = 0.02
"""Distance of the spline's points [rad]; with larger distances it deviates from the path."""

_FINE = 1e-3
"""Distance of the samples that are averaged [s]."""


_HALF = 0.53
"""Share of the widest window that suffices where acceleration does not jump between its limits."""

_ALMOST = 1.02
"""Excess up to which half of the window is kept, and the motion slowed."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of the motion, each of shape (n,) [rad/s, rad/s², rad/s³, N·m]."""

    velocity: Vector
    acceleration: Vector
    jerk: Vector
    effort: Vector


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """A motion from rest to rest: times, shape (k,) [s]; position, velocity, shape (k, n)."""

    times: Vector
    position: Vector
    velocity: Vector


Torques = Callable[[Vector, Vector, Vector], Vector]


def parametrize(path: Vector, limits: Limits, torques: Torques, period: float) -> Trajectory | None:
    """Return the fastest trajectory along a path; None: the limits allow none.

    path: shape (k, n) [rad], without duplicate points. torques: of position, velocity,
    acceleration. period: between two samples [s]. After Pham and Pham, A new approach to
    time-optimal path parameterization based on reachability analysis, 2018. A moving average then
    bounds the jerk (Biagiotti and Melchiorri, FIR filters for online trajectory planning, 2012): it
    changes no straight line, cuts corners by at most a·T²/24, and keeps velocities and
    accelerations below their peaks.
    """
    points = dense(path, _DENSE)
    along = np.concatenate([[0.0], np.cumsum(_lengths(points))])
    spline = toppra.SplineInterpolator(along, points)
    # The acceleration of a cubic spline peaks at its points; the grid has to include them all.
    grid = np.interp(np.arange(0, len(along) - 0.75, 0.5), np.arange(len(along)), along)
    most = (limits.velocity, limits.acceleration, limits.effort)
    velocity, acceleration, effort = (np.stack([-row, row], axis=1) for row in most)
    constraints = [
        constraint.JointVelocityConstraint(velocity),
        constraint.JointAccelerationConstraint(acceleration),
        constraint.JointTorqueConstraint(torques, effort, np.zeros(len(effort))),
    ]
    solver = algorithm.TOPPRA(constraints, spline, gridpoints=grid, solver_wrapper="seidel")
    result = solver.compute_trajectory(0.0, 0.0)
    return None if result is None else _sampled(result, path, limits, period)


def dense(path: Vector, distance: float) -> Vector:
    """Return a path with points inserted, so that none are farther apart than this [rad]."""
    segments = [path[:1]]
    for a, b, length in zip(path[:-1], path[1:], _lengths(path), strict=True):
        share = np.linspace(0.0, 1.0, max(math.ceil(length / distance), 1) + 1)[1:, None]
        segments.append(a + share * (b - a))
    return np.concatenate(segments)


def _lengths(points: Vector) -> Vector:
    length: Vector = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return length


def _sampled(result: Any, path: Vector, limits: Limits, period: float) -> Trajectory:
    """Return the motion smoothed, and sampled every period.

    Between the points of toppra's grid it may slightly exceed the limits; it is slowed for that.
    """
    for share in (_HALF, 1.0):
        factor = 1.0
        for _ in range(10):
            motion = _smoothed(result, path, limits, period, factor=factor, share=share)
            excess = _too_fast(motion, limits, period)
            if excess <= 1.0:
                return motion
            if share < 1.0 and excess > _ALMOST:
                break
            factor *= 1.002 * excess
    return motion


def _smoothed(
    result: Any, path: Vector, limits: Limits, period: float, *, factor: float, share: float
) -> Trajectory:
    """Return the motion in `factor` times its duration, averaged over a window of T.

    The jerk is (a(t) - a(t - T)) / T, at most 2 a / T. share: of the widest window.
    """
    # Slowed down, its accelerations are smaller than the limit by the square of the factor.
    window = float((2.0 * limits.acceleration / factor**2 / limits.jerk).max()) * share
    width = max(math.ceil(window / _FINE), 1)
    length = result.duration * factor
    inside = max(math.ceil(length / _FINE), 1)
    t = np.minimum(np.arange(inside + 1) * _FINE, length) / factor
    position, velocity = result(t), result(t, 1) / factor
    position[[0, -1]], velocity[[0, -1]] = path[[0, -1]], 0.0
    still = np.zeros((width, path.shape[1]))
    position = np.concatenate([still + path[0], position, still + path[-1]])
    velocity = np.concatenate([still, velocity, still])
    # By the trapezoidal rule with its correction from the slopes: exact for cubics.
    pieces = _FINE * (position[1:] + position[:-1]) / 2 - _FINE**2 * np.diff(velocity, axis=0) / 12
    area = np.concatenate([np.zeros((1, path.shape[1])), np.cumsum(pieces, axis=0)])
    mean = (area[width:] - area[:-width]) / (width * _FINE)
    slope = (position[width:] - position[:-width]) / (width * _FINE)
    every = round(period / _FINE)
    count = -(-(len(mean) - 1) // every)
    rows = np.minimum(np.arange(count + 1) * every, len(mean) - 1)
    mean, slope = mean[rows], slope[rows]
    mean[[0, -1]], slope[[0, -1]] = path[[0, -1]], 0.0
    times: Vector = np.arange(count + 1) * np.float64(period)
    return Trajectory(times=times, position=mean, velocity=slope)


def _too_fast(motion: Trajectory, limits: Limits, period: float) -> float:
    """Return the factor by which to slow a motion; 1: it is within its limits."""
    between = np.diff(motion.position, axis=0) / period
    fastest = np.abs([*motion.velocity, *between]).max(axis=0)
    pushes = np.diff(motion.velocity, axis=0) / period
    jerks = np.diff(pushes, axis=0, prepend=0.0 * pushes[:1], append=0.0 * pushes[:1]) / period
    ratios = [
        *(fastest / limits.velocity),
        *np.sqrt(np.abs(pushes).max(axis=0) / limits.acceleration),
        *np.cbrt(np.abs(jerks).max(axis=0) / limits.jerk),
    ]
    return max(1.0, *map(float, ratios))
