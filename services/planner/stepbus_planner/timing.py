"""How fast a way can be gone, by toppra."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepbus_kinematics import Vector

from .libraries import need

MODULES = ("toppra", "toppra.constraint", "toppra.algorithm")
"""What it is made of; importing it takes a second."""

_DENSE = 0.02
"""Distance of the points that the spline goes through [rad]; between further ones it strays."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Of the motion, each of shape (n,) [rad/s, rad/s², N·m]."""

    velocity: Vector
    acceleration: Vector
    effort: Vector


@dataclass(frozen=True, kw_only=True)
class Timed:
    """A motion from rest to rest: times, shape (k,) [s]; position, velocity, shape (k, n)."""

    times: Vector
    position: Vector
    velocity: Vector


Torques = Callable[[Vector, Vector, Vector], Vector]


def timed(way: Vector, limits: Limits, torques: Torques, period: float) -> Timed | None:
    """Return a way as a motion; None: it cannot be gone within the limits.

    way: shape (k, n) [rad], no two points the same. torques: of position, velocity, acceleration.
    period: distance of the times [s]. By Pham and Pham, A new approach to time-optimal path
    parameterization based on reachability analysis, 2018.
    """
    toppra, constraint, algorithm = need(*MODULES)
    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    points = dense(way, _DENSE)
    along = np.concatenate([[0.0], np.cumsum(_lengths(points))])
    path = toppra.SplineInterpolator(along, points)
    # The acceleration of a cubic spline is largest at its points; the grid has to have them all.
    grid = np.interp(np.arange(0, len(along) - 0.75, 0.5), np.arange(len(along)), along)
    velocity, acceleration = limits.velocity, limits.acceleration
    wanted = [
        constraint.JointVelocityConstraint(np.stack([-velocity, velocity], axis=1)),
        constraint.JointAccelerationConstraint(np.stack([-acceleration, acceleration], axis=1)),
        constraint.JointTorqueConstraint(
            torques,
            np.stack([-limits.effort, limits.effort], axis=1),
            np.zeros(len(limits.effort)),
        ),
    ]
    motion = algorithm.TOPPRA(wanted, path, gridpoints=grid, solver_wrapper="seidel")
    found = motion.compute_trajectory(0.0, 0.0)
    return None if found is None else _sampled(found, way, limits, period)


def dense(way: Vector, distance: float) -> Vector:
    """Return a way with points between its own, so that no two are further apart [rad]."""
    rows = [way[:1]]
    for a, b, length in zip(way[:-1], way[1:], _lengths(way), strict=True):
        share = np.linspace(0.0, 1.0, max(math.ceil(length / distance), 1) + 1)[1:, None]
        rows.append(a + share * (b - a))
    return np.concatenate(rows)


def _lengths(points: Vector) -> Vector:
    length: Vector = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return length


def _sampled(found: Any, way: Vector, limits: Limits, period: float) -> Timed:
    """Return the motion every period, slowed so that it takes a whole number of them.

    Between the points of toppra's grid it may be a little over the limits; it is slowed for that.
    """
    motion = _slowed(found, way, max(math.ceil(found.duration / period), 1), period)
    # Every new sampling may meet a sharper spot; one or two rounds do.
    for _ in range(10):
        factor = _too_fast(motion, limits, period)
        if factor <= 1.0:
            break
        motion = _slowed(found, way, math.ceil((len(motion.times) - 1) * factor), period)
    return motion


def _slowed(found: Any, way: Vector, count: int, period: float) -> Timed:
    """Return the motion in a number of periods."""
    at = np.linspace(0.0, found.duration, count + 1)
    position, velocity = found(at), found(at, 1) * (found.duration / (count * period))
    position[[0, -1]], velocity[[0, -1]] = way[[0, -1]], 0.0
    times: Vector = np.arange(count + 1) * np.float64(period)
    return Timed(times=times, position=position, velocity=velocity)


def _too_fast(motion: Timed, limits: Limits, period: float) -> float:
    """Return by which factor a motion has to be slowed, 1 where it is within its limits."""
    between = np.diff(motion.position, axis=0) / period
    fastest = np.abs([*motion.velocity, *between]).max(axis=0)
    sharpest = np.abs(np.diff(motion.velocity, axis=0) / period).max(axis=0)
    ratios = [*(fastest / limits.velocity), *np.sqrt(sharpest / limits.acceleration)]
    return max(1.0, *map(float, ratios))
