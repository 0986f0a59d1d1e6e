"""Several environments of one scenario, which trainers step together."""

from typing import Any

from gymnasium.vector import AutoresetMode, SyncVectorEnv

from stepbus.runs import AnyScenario
from stepbus_gym.env import StepbusEnv


class StepbusVectorEnv(SyncVectorEnv):
    """Environments of one scenario, stepped one after the other in this process.

    count: how many. scenario, options: as of `StepbusEnv`; the scenario is loaded once. After
    `reset(seed=7)`, the environment at index i makes the same episodes as a `StepbusEnv` after
    `reset(seed=7 + i)`, to the last bit. autoreset_mode: as of `SyncVectorEnv`.

    Raises the errors of `StepbusEnv`.
    """

    def __init__(
        self,
        count: int,
        scenario: AnyScenario,
        *args: Any,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        first = StepbusEnv(scenario, *args, **options)
        made = [lambda: first, *[first.twin] * (count - 1)]
        super().__init__(made, autoreset_mode=autoreset_mode)
