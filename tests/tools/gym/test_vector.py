"""Several environments at once, as trainers use them."""

import gymnasium
import numpy as np
import pytest

import stepbus_gym

pytestmark = pytest.mark.slow


def nothing(_moment):
    return 0.0


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


def episodes(count):
    """Return the observations of two episodes of each environment of a vector."""
    noise = {"plant.params.noise.position": 0.01}
    env = stepbus_gym.StepbusVectorEnv(
        count, "two_link", reward=nothing, duration="50ms", set=noise
    )
    try:
        rows = [env.reset(seed=5)[0]]
        rows += [env.step(np.full((count, 2), 3.0))[0] for _ in range(20)]
    finally:
        env.close()
    return np.array(rows)


def test_vectors_of_1_4_and_16_make_the_same_episodes():
    rows = episodes(16)
    assert not np.array_equal(rows[:, 0], rows[:, 1])
    for count in (1, 4):
        assert np.array_equal(rows[:, :count], episodes(count))
