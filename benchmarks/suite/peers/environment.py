"""An episode of a hand-written Gymnasium environment: what a step costs without stepbus."""

import sys
from typing import Any

import gymnasium
import numpy as np
from benchmarks.suite.clock import Clock
from numpy.typing import NDArray

from .arm import Plant, reference

Vector = NDArray[np.float64]


class Arm(gymnasium.Env[Vector, Vector]):
    """The arm of two_link with its reference, as somebody would write it for PyBullet."""

    def __init__(self, steps: int) -> None:
        self.action_space = gymnasium.spaces.Box(-50.0, 50.0, (2,), np.float64)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (12,), np.float64)
        self._steps, self._step = steps, 0
        self._plant = Plant()

    def step(self, action: Vector) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """Advance by a step."""
        torques = np.clip(np.asarray(action, np.float64), -50.0, 50.0)
        self._plant.step(torques.tobytes())
        self._step += 1
        is_over = self._step >= self._steps
        seen = np.frombuffer(self._plant.state() + torques.tobytes() + reference(self._step))
        return seen.copy(), 0.0, False, is_over, {"step": self._step}


def main(steps: int) -> None:
    """Make an episode."""
    env, clock, action, is_over = Arm(steps), Clock(), np.zeros(2), False
    while not is_over:
        *_, is_over, _info = env.step(action)
        clock.tick()
    clock.show()


if __name__ == "__main__":
    main(int(sys.argv[1]))
