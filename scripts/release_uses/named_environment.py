"""An environment by its name."""

import gymnasium

import stepbus_gym

assert stepbus_gym.StepbusEnv  # the import registers it

env = gymnasium.make("stepbus/two_link-v0")
env.reset(seed=1)
env.step(env.action_space.sample())
env.close()
