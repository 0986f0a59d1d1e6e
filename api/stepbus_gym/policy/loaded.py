"""A policy that is a function of a module of yours."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stepbus_gym.interface import Vector
from stepbus_participant import Config, Step
from stepbus_schemas import WiringError

from .load import checked_action, load_policy
from .participant import PolicyParticipant

_HERE = Path.cwd()


class LoadedPolicy(PolicyParticipant):
    """Decides by the function that its parameters name, or else `policy`."""

    def __init__(self, config: Config, policy: str = "") -> None:
        super().__init__(config, self._decide)
        name = policy or self.params.policy
        if not name:
            raise WiringError(
                "no policy is recorded; name it, e.g. stepbus replay run.mcap --participant "
                f"{config.name} --exec python -m stepbus_gym.policy my_policy:act"
            )
        self._policy = load_policy(name, [config.folder, _HERE])

    def _decide(self, observation: Vector, _inputs: Mapping[str, Any], step: Step) -> Vector:
        size = 0 if self.interface is None else len(self.interface.action)
        return checked_action(self._policy(observation), size, step.index)
