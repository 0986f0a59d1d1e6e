"""An episode of a scenario of its own, to its end."""

from stepbus_gym import StepbusEnv

limits = {"command.values": (-5, 5)}
env = StepbusEnv(
    "scenario.yaml", participant="controller", duration="100ms", reward=lambda moment: moment.t,
    limits=limits,
)  # fmt: skip
env.reset(seed=1)
env.action_space.seed(1)
steps, is_over = 0, False
while not is_over:
    *_, terminated, truncated, _ = env.step(env.action_space.sample())
    steps, is_over = steps + 1, terminated or truncated
env.close()
assert steps >= 19, steps
