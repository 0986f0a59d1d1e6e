"""Several environments at once, as trainers use them."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

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


class Counter(gymnasium.Env):
    """An environment without stepbus: four steps of reward 1."""

    observation_space = action_space = gymnasium.spaces.Box(-9, 9, (2,), np.float64)

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        self.count = 0
        return np.zeros(2), {"step": 0}

    def step(self, action):
        self.count += 1
        return np.full(2, self.count), 1.0, False, self.count == 4, {"step": self.count}


def after_the_end(env):
    """Return what the steps at the end of an episode, and after it, give besides observations."""
    rows = []
    env.reset(seed=5)
    for _ in range(6):
        try:
            _, rewards, ends, truncated, info = env.step(np.ones((2, 2)))
        except AssertionError as exc:
            rows.append(type(exc).__name__)
            _, info = env.reset(options={"reset_mask": np.array([True, True])})
            continue
        given = [rewards, ends, truncated, info["step"]]
        given += [info["final_info"]["step"]] if "final_info" in info else []
        rows.append([part.tolist() for part in given])
    env.close()
    return rows[3:]


YES, NO, ONE = [True, True], [False, False], [1.0, 1.0]
STEP_1, STEP_2 = ([ONE, NO, NO, [step, step]] for step in (1, 2))
ENDED = {
    AutoresetMode.NEXT_STEP: [[ONE, NO, YES, [4, 4]], [[0.0, 0.0], NO, NO, [0, 0]], STEP_1],
    AutoresetMode.SAME_STEP: [[ONE, NO, YES, [0, 0], [4, 4]], STEP_1, STEP_2],
    AutoresetMode.DISABLED: [[ONE, NO, YES, [4, 4]], "AssertionError", STEP_1],
}


def one(_moment):
    return 1.0


@pytest.mark.parametrize("mode", AutoresetMode)
def test_episodes_follow_one_another_as_gymnasium_has_them(mode):
    options = {"reward": one, "duration": "20ms", "autoreset_mode": mode}
    assert after_the_end(SyncVectorEnv([Counter] * 2, autoreset_mode=mode)) == ENDED[mode]
    assert after_the_end(stepbus_gym.StepbusVectorEnv(2, "two_link", **options)) == ENDED[mode]


def test_the_action_at_a_reset_is_ignored_and_the_last_observation_kept():
    options = {"reward": one, "duration": "20ms"}
    alone = stepbus_gym.StepbusEnv("two_link", **options)
    alone.reset(seed=5)
    last = [alone.step(np.ones(2))[0] for _ in range(4)][-1]
    second, _ = alone.reset()
    alone.close()
    for mode in ("NextStep", "SameStep"):
        env = stepbus_gym.StepbusVectorEnv(1, "two_link", **options, autoreset_mode=mode)
        env.reset(seed=5)
        *_, (observation, _, _, _, info) = [env.step(np.ones((1, 2))) for _ in range(4)]
        if mode == "NextStep":
            info["final_obs"], observation = observation, env.step(np.full((1, 2), 9.0))[0]
        assert np.array_equal(info["final_obs"][0], last)
        assert np.array_equal(observation[0], second)
        env.close()
