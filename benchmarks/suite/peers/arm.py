"""The work of a step of two_link, by hand: an engine's step, a Pinocchio torque, a reference."""

import math
import struct
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio
import pybullet

import stepbus_scenarios

URDF = str(Path(stepbus_scenarios.__file__).parent / "two_link/two_link.urdf")
STEP_S = 0.005
KP, KD = 100.0, 20.0
_STATE = struct.Struct("<4d")
_REFERENCE = struct.Struct("<6d")
_COMMAND = struct.Struct("<2d")


class Plant:
    """Two joints under torque."""

    def __init__(self) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        pybullet.setGravity(0, 0, -9.81)
        pybullet.setTimeStep(STEP_S)
        self._body = pybullet.loadURDF(URDF, useFixedBase=True)
        pybullet.resetJointState(self._body, 1, 1.0)
        for joint in (0, 1):
            pybullet.setJointMotorControl2(self._body, joint, pybullet.VELOCITY_CONTROL, force=0.0)

    def state(self) -> bytes:
        """Return positions and velocities."""
        first, second = pybullet.getJointStates(self._body, (0, 1))
        return _STATE.pack(first[0], second[0], first[1], second[1])

    def step(self, command: bytes) -> None:
        """Advance by a step under two torques."""
        pybullet.setJointMotorControlArray(
            self._body, (0, 1), pybullet.TORQUE_CONTROL, forces=_COMMAND.unpack(command)
        )
        pybullet.stepSimulation()


class MujocoPlant:
    """The same with MuJoCo's own Python."""

    def __init__(self) -> None:
        spec: Any = mujoco.MjSpec.from_file(URDF)
        spec.option.timestep = STEP_S
        self._model = spec.compile()
        self._data: Any = mujoco.MjData(self._model)
        self._data.qpos[1] = 1.0

    def state(self) -> bytes:
        """Return positions and velocities."""
        return bytes(self._data.qpos.tobytes() + self._data.qvel.tobytes())

    def step(self, command: bytes) -> None:
        """Advance by a step under two torques."""
        self._data.qfrc_applied[:] = np.frombuffer(command)
        mujoco.mj_step(self._model, self._data)


class Controller:
    """Computed torque."""

    def __init__(self) -> None:
        self._model = pinocchio.buildModelFromUrdf(URDF)
        self._data = self._model.createData()

    def torque(self, state: bytes, reference: bytes) -> bytes:
        """Return the torques for a state and a reference."""
        values = np.frombuffer(state)
        wanted = np.frombuffer(reference)
        q, v = values[:2], values[2:]
        a = wanted[4:] + KP * (wanted[:2] - q) + KD * (wanted[2:4] - v)
        return _COMMAND.pack(*pinocchio.rnea(self._model, self._data, q, v, a))


def reference(step: int) -> bytes:
    """Return positions, velocities and accelerations of the reference at a step."""
    t = step * STEP_S
    s, c = math.sin(t), math.cos(t)
    return _REFERENCE.pack(s, c, c, -s, -s, -c)
