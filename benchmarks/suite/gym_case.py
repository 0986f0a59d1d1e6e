"""An episode of two_link as an environment: `python -m benchmarks.suite.gym_case STEPS`."""

import sys

import numpy as np

from stepbus_gym import StepbusEnv

from .clock import Clock


def main(steps: int) -> None:
    """Make an episode."""
    env = StepbusEnv("two_link", reward=lambda _moment: 0.0, duration=f"{steps * 5}ms")
    env.reset(seed=0)
    clock, action, is_over = Clock(), np.zeros(2), False
    while not is_over:
        *_, is_over, _info = env.step(action)
        clock.tick()
    clock.show()
    env.close()


if __name__ == "__main__":
    main(int(sys.argv[1]))
