# mypy: ignore-errors
"""The arm as an environment of Gymnasium, simulated by PyBullet."""

from pathlib import Path
from typing import Any

import arm
import gymnasium
import numpy as np
import pybullet

URDF = Path(__file__).with_name("arm.urdf")
JOINTS = range(2)


class ArmEnv(gymnasium.Env):
    """Observation: position and velocity [rad], [rad/s]; action: torque [N·m]."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (4,), np.float64)
    action_space = gymnasium.spaces.Box(-arm.EFFORT, arm.EFFORT, (2,), np.float64)

    def __init__(self) -> None:
        self.client = pybullet.connect(pybullet.DIRECT)
        self.trace = arm.Trace()

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        pybullet.resetSimulation()
        pybullet.setTimeStep(arm.STEP_S)
        pybullet.setGravity(0, 0, -9.81)
        self.robot = pybullet.loadURDF(str(URDF), useFixedBase=True)
        for joint in JOINTS:
            pybullet.changeDynamics(self.robot, joint, linearDamping=0, angularDamping=0)
            pybullet.setJointMotorControl2(self.robot, joint, pybullet.VELOCITY_CONTROL, force=0)
        self.steps = 0
        return self.observe(), {}

    def observe(self) -> Any:
        states = pybullet.getJointStates(self.robot, JOINTS)
        return np.array([s[0] for s in states] + [s[1] for s in states])

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        before = self.observe().tolist()
        self.trace.write(self.steps, before[:2], before[2:], action.tolist())
        pybullet.setJointMotorControlArray(
            self.robot, JOINTS, pybullet.TORQUE_CONTROL, forces=action.tolist()
        )
        pybullet.stepSimulation()
        self.steps += 1
        return self.observe(), 0.0, False, self.steps == arm.STEPS, {}

    def close(self) -> None:
        pybullet.disconnect(self.client)
