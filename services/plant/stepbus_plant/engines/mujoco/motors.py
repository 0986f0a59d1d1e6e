"""Motors of joints: velocities that are reached with limited torques.

A motor is dry friction of MuJoCo, of a tendon along its joint, with another velocity than 0: the
solver takes the torque, within a limit, that a substep needs, together with all contacts. An
actuator with as stiff a gain would chatter at its limit of force.
"""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from stepbus_plant.engine import Goal

_GAIN = 0.1
"""Share of the error of a position that a substep corrects, where nothing else is asked for."""
_IMPEDANCE = 0.9999
"""The hardest that MuJoCo has: what a motor commands is reached within 1e-4 of the change."""


def motor_of(joint: str) -> str:
    """Return the name of the motor of a joint."""
    return f"{joint} motor"


def add_motor(spec: Any, joint: str, dt: float) -> None:
    """Add the motor of a joint, without torque; dt: length of a substep [s]."""
    tendon = spec.add_tendon(
        name=motor_of(joint),
        # Of a negative one, MuJoCo takes the damping [1/s]: it stops within a substep.
        solref_friction=[-1.0, -_IMPEDANCE / dt],
        solimp_friction=[_IMPEDANCE, _IMPEDANCE, 1e-3, 0.5, 2.0],
    )
    tendon.wrap_joint(joint, 1.0)


class Motors:
    """The motors of a model, arrays of shape (n,) by the number of their tendon.

    dt: length of a substep [s]. torques: of the latest one [N·m].
    """

    def __init__(self, model: Any, dt: float) -> None:
        count = model.ntendon
        self._model, self._dt = model, dt
        self._velocities, self._goals = np.zeros(count), np.zeros(count)
        self._gains, self._fastest = np.zeros(count), np.full(count, np.inf)
        self.torques = np.zeros(count)
        # Of the friction that joints have themselves, before that of tendons.
        self._joint_rows = int(np.count_nonzero(model.dof_frictionloss))

    def turn(
        self, motors: NDArray[np.int64], velocities: Sequence[float], torques: Sequence[float]
    ) -> None:
        """Track velocities [rad/s] with limited torques [N·m]."""
        self._velocities[motors], self._gains[motors], self._fastest[motors] = velocities, 0, np.inf
        self._model.tendon_frictionloss[motors] = torques

    def bring(self, motor: int, goal: Goal) -> None:
        """Track a position and its velocity."""
        self._goals[motor], self._velocities[motor] = goal.position, goal.velocity
        self._fastest[motor] = goal.max_velocity or np.inf
        self._gains[motor] = goal.gain or _GAIN
        self._model.tendon_frictionloss[motor] = goal.torque

    def step(self, data: Any) -> None:
        """Advance by one substep."""
        mujoco.mj_step1(self._model, data)
        rows = slice(data.ne + self._joint_rows, data.ne + data.nf)
        motors = data.efc_id[rows]
        # A motor without torque has no row: in mode torque there is none.
        if motors.size:
            error = self._goals[motors] - data.ten_length[motors]
            wanted = self._velocities[motors] + self._gains[motors] * error / self._dt
            fastest = self._fastest[motors]
            data.efc_aref[rows] += np.clip(wanted, -fastest, fastest) / self._dt
        mujoco.mj_step2(self._model, data)
        self.torques.fill(0.0)
        if motors.size:
            self.torques[motors] = data.efc_force[rows]
