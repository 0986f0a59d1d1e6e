"""Finds a policy: a function of an observation."""

import importlib
import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stepbus_gym.interface import Vector
from stepbus_gym.policy.participant import PolicyParticipant
from stepbus_participant import Config, Step
from stepbus_schemas import RunError, WiringError, error_text, text_of

Policy = Callable[[Vector], Any]


def load_policy(name: str, folders: list[Path]) -> Policy:
    """Return the policy that `module:function` names; a class is made once.

    folders: searched before the installed modules. Raises WiringError where there is none.
    """
    module_name, _, attribute = name.partition(":")
    if not module_name or not attribute.isidentifier():
        raise WiringError(f"{name!r} names no policy; write module:function, e.g. my_policy:act")
    path = list(sys.path)
    try:
        sys.path[:0] = map(str, folders)
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as exc:
        where = " or ".join(map(str, folders))
        raise WiringError(
            f"policy {name}: no module {exc.name!r} in {where}, or installed"
        ) from exc
    except Exception as exc:
        raise WiringError(f"policy {name} cannot be imported: {error_text(exc)}") from exc
    finally:
        sys.path[:] = path
    loaded = getattr(module, attribute, None)
    made = loaded() if isinstance(loaded, type) else loaded
    if not callable(made):
        raise WiringError(f"module {module_name!r} has no function {attribute!r}")
    policy: Policy = made
    return policy


def checked_action(action: Any, size: int, step: int) -> Vector:
    """Return an action as a vector; raises RunError for one of another form or not finite."""
    try:
        vector = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError) as exc:
        raise RunError(f"step {step}: the action is no vector of numbers: {text_of(exc)}") from exc
    if vector.shape != (size,):
        raise RunError(f"step {step}: the action has the shape {vector.shape}, not ({size},)")
    # Of a few numbers, this takes a tenth of what NumPy takes.
    if not all(map(math.isfinite, vector.tolist())):
        index = int(np.flatnonzero(~np.isfinite(vector))[0])
        raise RunError(f"step {step}: entry {index} of the action is {vector[index]}")
    return vector


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
