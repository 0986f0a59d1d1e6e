"""Several environments of one scenario, which trainers step together."""

from typing import Any

from gymnasium.vector import SyncVectorEnv

from stepbus.runs import AnyScenario
from stepbus_gym.env import StepbusEnv


class StepbusVectorEnv(SyncVectorEnv):
    """Environments of one scenario, stepped one after the other in this process.

    count: how many. scenario, options: as of `StepbusEnv`; the scenario is loaded once. After
    `reset(seed=7)`, the environment at index i makes the same episodes as a `StepbusEnv` after
    `reset(seed=7 + i)`, to the last bit.

    Raises the errors of `StepbusEnv`.
    """

    def __init__(self, count: int, scenario: AnyScenario, *args: Any, **options: Any) -> None:
        first = StepbusEnv(scenario, *args, **options)
        super().__init__([lambda: first, *[first.twin] * (count - 1)])
