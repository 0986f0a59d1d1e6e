"""Time parametrization of paths with toppra."""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepbus_kinematics import Vector
from stepbus_participant import need

MODULES = ("toppra", "toppra.constraint", "toppra.algorithm")
"""The libraries it needs; importing them takes a second."""

_DENSE = 0.02
"""Distance of the spline's points [rad]; with larger distances it deviates from the path."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of the motion, each of shape (n,) [rad/s, rad/s², N·m]."""

    velocity: Vector
    acceleration: Vector
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
    time-optimal path parameterization based on reachability analysis, 2018.
    """
    toppra, constraint, algorithm = need("the planner", *MODULES)
    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    points = dense(path, _DENSE)
    along = np.concatenate([[0.0], np.cumsum(_lengths(points))])
    spline = toppra.SplineInterpolator(along, points)
    # The acceleration of a cubic spline peaks at its points; the grid has to include them all.
    grid = np.interp(np.arange(0, len(along) - 0.75, 0.5), np.arange(len(along)), along)
    velocity, acceleration = limits.velocity, limits.acceleration
    constraints = [
        constraint.JointVelocityConstraint(np.stack([-velocity, velocity], axis=1)),
        constraint.JointAccelerationConstraint(np.stack([-acceleration, acceleration], axis=1)),
        constraint.JointTorqueConstraint(
            torques,
            np.stack([-limits.effort, limits.effort], axis=1),
            np.zeros(len(limits.effort)),
        ),
    ]
    solver = algorithm.TOPPRA(constraints, spline, gridpoints=grid, solver_wrapper="seidel")
    found = solver.compute_trajectory(0.0, 0.0)
    return None if found is None else _sampled(found, path, limits, period)


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


def _sampled(found: Any, path: Vector, limits: Limits, period: float) -> Trajectory:
    """Return the motion sampled every period, slowed to a whole number of periods.

    Between the points of toppra's grid it may slightly exceed the limits; it is slowed for that.
    """
    motion = _slowed(found, path, max(math.ceil(found.duration / period), 1), period)
    # A new sampling may hit a higher peak; one or two rounds suffice.
    for _ in range(10):
        factor = _too_fast(motion, limits, period)
        if factor <= 1.0:
            break
        motion = _slowed(found, path, math.ceil((len(motion.times) - 1) * factor), period)
    return motion


def _slowed(found: Any, path: Vector, count: int, period: float) -> Trajectory:
    """Return the motion stretched to a number of periods."""
    t = np.linspace(0.0, found.duration, count + 1)
    position, velocity = found(t), found(t, 1) * (found.duration / (count * period))
    position[[0, -1]], velocity[[0, -1]] = path[[0, -1]], 0.0
    times: Vector = np.arange(count + 1) * np.float64(period)
    return Trajectory(times=times, position=position, velocity=velocity)


def _too_fast(motion: Trajectory, limits: Limits, period: float) -> float:
    """Return the factor by which to slow a motion; 1: it is within its limits."""
    between = np.diff(motion.position, axis=0) / period
    fastest = np.abs([*motion.velocity, *between]).max(axis=0)
    sharpest = np.abs(np.diff(motion.velocity, axis=0) / period).max(axis=0)
    ratios = [*(fastest / limits.velocity), *np.sqrt(sharpest / limits.acceleration)]
    return max(1.0, *map(float, ratios))
