"""Motors of joints: velocities that are reached with limited torques, as friction is.

MuJoCo solves dry friction of a joint together with contacts: it takes the torque, within a limit,
that stops the joint. A motor is the same with another velocity than 0.
"""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from stepbus_plant.geometry import Array

_GAIN = 0.1
"""Share of the error of a position that a substep corrects, where nothing else is asked for."""
_SOFTER = 1e-3
"""Of the constraint's compliance: what a motor commands is reached within 1e-4 of the change."""


class Motors:
    """The motors of all degrees of freedom, shape (n,) each.

    places: where each one's position is in the state. torques: of the latest substep [N·m].
    """

    def __init__(self, model: Any, dt: float) -> None:
        count = model.nv
        self._dt = dt
        self._limits = np.zeros(count)
        self._velocities = np.zeros(count)
        self._goals = np.full(count, np.nan)
        self._gains = np.full(count, _GAIN)
        self._fastest = np.full(count, np.inf)
        self.torques = np.zeros(count)
        self.places = np.zeros(count, dtype=np.int64)
        for joint in range(model.njnt):
            if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
                self.places[model.jnt_dofadr[joint]] = model.jnt_qposadr[joint]
        self._model = model
        self._has_goals, self._has_changed = False, True

    def _arrays(self) -> tuple[Array, ...]:
        return (
            *(self._limits, self._velocities, self._goals),
            *(self._gains, self._fastest, self.torques),
        )

    def take(self, before: "Motors") -> None:
        """Go on as other motors, of fewer or as many degrees of freedom, before these."""
        for own, old in zip(self._arrays(), before._arrays(), strict=True):
            own[: len(old)] = old
        self._has_goals = before._has_goals

    def turn(
        self, dofs: NDArray[np.int64], velocities: Sequence[float], torques: Sequence[float]
    ) -> None:
        """Track velocities [rad/s] with limited torques [N·m]."""
        self._velocities[dofs], self._limits[dofs] = velocities, torques
        if self._has_goals:
            self._goals[dofs] = np.nan
            self._has_goals = not np.isnan(self._goals).all()
        self._has_changed = True

    def bring(
        self, dof: int, goal: tuple[float, float], torque: float, fastest: float, gain: float
    ) -> None:
        """Track a position [rad] and its velocity, no faster than `fastest` [rad/s]."""
        (self._goals[dof], self._velocities[dof]), self._limits[dof] = goal, torque
        self._fastest[dof], self._gains[dof] = fastest, gain or _GAIN
        self._has_goals = self._has_changed = True

    def set_limits(self, data: Any) -> None:
        """Tell MuJoCo the limits; before it makes its constraints."""
        if self._has_changed:
            self._model.dof_frictionloss[:] = self._limits
            self._has_changed = False

    def aim(self, data: Any) -> None:
        """Tell MuJoCo which velocities; after it has made its constraints."""
        if not data.nf:
            return
        rows = slice(data.ne, data.ne + data.nf)
        dofs = data.efc_id[rows]
        wanted = self._velocities[dofs]
        if self._has_goals:
            wanted = self._towards_goals(data, dofs, wanted)
        data.efc_aref[rows] = (wanted - data.qvel[dofs]) / self._dt
        softness = data.efc_R[rows]
        softness *= _SOFTER
        data.efc_D[rows] = 1.0 / softness

    def _towards_goals(self, data: Any, dofs: NDArray[np.int64], velocities: Array) -> Array:
        """Return velocities, with what corrects the positions of those that have a goal."""
        goals = self._goals[dofs]
        error = np.where(np.isnan(goals), 0.0, goals - data.qpos[self.places[dofs]])
        wanted = velocities + self._gains[dofs] * error / self._dt
        fastest = np.where(np.isnan(goals), np.inf, self._fastest[dofs])
        return np.clip(wanted, -fastest, fastest)

    def feel(self, data: Any) -> None:
        """Keep the torques of a substep."""
        self.torques[:] = 0.0
        if data.nf:
            rows = slice(data.ne, data.ne + data.nf)
            self.torques[data.efc_id[rows]] = data.efc_force[rows]

    def save(self) -> list[list[float]]:
        """Return their state."""
        return [array.tolist() for array in self._arrays()]

    def restore(self, saved: Sequence[Sequence[float]]) -> None:
        """Take what `save` returned."""
        for array, values in zip(self._arrays(), saved, strict=True):
            array[:] = values
        self._has_goals, self._has_changed = not np.isnan(self._goals).all(), True
