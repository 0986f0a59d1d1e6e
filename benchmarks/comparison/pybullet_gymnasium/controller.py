# mypy: ignore-errors
"""The PD controller as the loop around the environment; it keeps what it saw and did."""

import arm
import numpy as np
from plant import ArmEnv


def main() -> None:
    """Run one episode and save it."""
    env = ArmEnv()
    observation, _ = env.reset(seed=1)
    seen, done = [], []
    truncated = False
    while not truncated:
        q1, q2, v1, v2 = observation.tolist()
        action = np.array(arm.control(len(done), (q1, q2), (v1, v2)))
        seen.append(observation)
        done.append(action)
        observation, _, _, truncated, _ = env.step(action)
    np.savez("episode.npz", observations=seen, actions=done)
    env.close()


if __name__ == "__main__":
    main()
