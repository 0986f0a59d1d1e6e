"""Several environments at once, as trainers use them."""

import gymnasium
import numpy as np
import pytest

import stepbus_gym  # noqa: F401  (registers)

pytestmark = pytest.mark.slow


def make():
    return gymnasium.make("stepbus/two_link-v0", duration="100ms", terminated=None)


@pytest.mark.parametrize("name", ["SyncVectorEnv", "AsyncVectorEnv"])
def test_a_vector_of_environments_makes_the_steps_of_one(name):
    env = getattr(gymnasium.vector, name)([make] * 3)
    alone = make()
    actions = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    try:
        env.reset(seed=0)
        alone.reset(seed=2)
        for _ in range(20):
            observations, rewards, _, truncated, info = env.step(actions)
            observation, reward, *_ = alone.step(actions[2])
            assert np.array_equal(observations[2], observation)
            assert rewards[2] == reward
        assert truncated.all()
        assert info["step"].tolist() == [20, 20, 20]
        # The next step begins the next episode.
        assert env.step(actions)[4]["step"].tolist() == [0, 0, 0]
    finally:
        env.close()
        alone.close()
