"""Rigid-body dynamics of a fixed-base robot, with its joints in an order of our choice."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from stepbus_participant.models import read_urdf_text
from stepbus_participant.settings import nearest
from stepbus_schemas import WiringError

Vector = NDArray[np.float64]

STANDARD_GRAVITY = (0.0, 0.0, -9.81)


class Dynamics:
    """Inverse dynamics by Pinocchio.

    path: URDF. joints: those to be controlled, in the order of every vector; all others are held
    at their neutral position; None: all, in Pinocchio's order. gravity: in the frame of the
    robot's base, shape (3,) [m/s²].
    Raises WiringError for a file that is no URDF, an unknown joint, or one with more than one
    degree of freedom.
    """

    def __init__(
        self,
        path: Path,
        joints: Sequence[str] | None = None,
        gravity: Sequence[float] = STANDARD_GRAVITY,
    ) -> None:
        model = reduced(read_urdf(path), joints, path)
        model.gravity.linear = np.array(gravity, dtype=np.float64)
        self.joints = tuple(joints) if joints is not None else tuple(model.names)[1:]
        ids = [model.getJointId(name) for name in self.joints]
        self._model = model
        self._data = model.createData()
        self._in_velocity = np.array([model.idx_vs[i] for i in ids], dtype=np.intp)
        in_position = np.array([model.idx_qs[i] for i in ids], dtype=np.intp)
        continuous = np.array([model.nqs[i] == 2 for i in ids])
        self._plain, self._in_plain = np.flatnonzero(~continuous), in_position[~continuous]
        self._turning, self._in_turning = np.flatnonzero(continuous), in_position[continuous]
        self._position = pin.neutral(model)
        self._velocity = np.zeros(model.nv)
        self._acceleration = np.zeros(model.nv)

    @property
    def effort_limit(self) -> Vector:
        """Return the largest torques the URDF allows, shape (n,) [N·m]."""
        limit: Vector = np.array(self._model.upperEffortLimit)[self._in_velocity]
        return limit

    def inverse(self, q: Vector, v: Vector, a: Vector) -> Vector:
        """Return the torques M(q) a + C(q, v) v + g(q), shape (n,) [N·m].

        q, v, a: positions, velocities, accelerations, shape (n,) [rad, rad/s, rad/s²]. By the
        recursive Newton-Euler algorithm (Featherstone, Rigid Body Dynamics Algorithms, 2008,
        table 5.1).
        """
        self._set_position(q)
        self._velocity[self._in_velocity] = v
        self._acceleration[self._in_velocity] = a
        torque: Vector = pin.rnea(
            self._model, self._data, self._position, self._velocity, self._acceleration
        )
        return torque[self._in_velocity]

    def gravity(self, q: Vector) -> Vector:
        """Return the torques g(q) that hold the robot at rest, shape (n,) [N·m].

        q: positions, shape (n,) [rad].
        """
        self._set_position(q)
        torque: Vector = pin.computeGeneralizedGravity(self._model, self._data, self._position)
        return torque[self._in_velocity]

    def _set_position(self, q: Vector) -> None:
        self._position[self._in_plain] = q[self._plain]
        if self._turning.size:
            # Pinocchio stores the cosine and sine of a continuous joint's angle.
            angle = q[self._turning]
            self._position[self._in_turning] = np.cos(angle)
            self._position[self._in_turning + 1] = np.sin(angle)


def read_urdf(path: Path) -> Any:
    """Return Pinocchio's model of a robot; raises WiringError for a file that is no URDF.

    path: a URDF, or a `.xacro`, which is expanded.
    """
    text = read_urdf_text(path)
    try:
        return pin.buildModelFromXML(text)
    except ValueError as exc:
        raise WiringError(f"{path} is not a URDF that Pinocchio can read") from exc


def reduced(model: Any, joints: Sequence[str] | None, path: Path) -> Any:
    """Return the model with only the wanted joints free to move, the others at neutral.

    Raises WiringError for joints that are unknown or have more than one degree of freedom.
    """
    movable = tuple(model.names)[1:]
    wanted = movable if joints is None else joints
    problems = [
        f"joint {name!r} is not in {path}; {nearest(name, movable)}"
        for name in wanted
        if name not in movable
    ]
    problems += [
        f"joint {name!r} of {path} has {model.nvs[model.getJointId(name)]} degrees of freedom; "
        "only joints with one can be controlled"
        for name in wanted
        if name in movable and model.nvs[model.getJointId(name)] != 1
    ]
    if problems or not wanted:
        raise WiringError("\n".join(problems) or f"{path} has no movable joint")
    locked = [model.getJointId(name) for name in movable if name not in wanted]
    return pin.buildReducedModel(model, locked, pin.neutral(model)) if locked else model
