"""A policy as a participant of its own."""

import math
import pkgutil
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stepbus_gym.interface import Interface, Params, PolicyPorts, Vector
from stepbus_participant import Config, Participant, Step
from stepbus_schemas import Description, Message, RunError, WiringError, error_text, text_of

__all__ = ["LoadedPolicy", "Params", "PolicyParticipant", "checked_action", "load_policy"]

_HERE = Path.cwd()
_LONGEST_WAIT = 1000
Act = Callable[[Vector, Mapping[str, Any], Step], Vector]


class PolicyParticipant(Participant):
    """Answers each observation by an action; publishes nothing until all that it observes came.

    act: gets the observation, the newest message of each input (None: there is none yet) and the
    step; returns the action. Parameters: see `Params`.
    """

    def __init__(self, config: Config, act: Act) -> None:
        super().__init__(config)
        self.params = config.read(Params)
        self.interface: Interface | None = None
        self._act = act
        self._waited = 0
        self._ports = PolicyPorts(
            inputs={port: row.type for port, row in config.inputs.items()},
            outputs={port: row.type for port, row in config.outputs.items()},
            types=config.types,
        )

    def describe(self) -> Mapping[str, Description]:
        """Return the joints that the policy commands."""
        return self._ports.described(self.params)

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Lay out observation and action."""
        self.interface = Interface(self._ports, self.params, inputs)

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the messages of the policy's action."""
        interface = self.interface
        if interface is None:
            raise RunError("the run has not started")
        inputs = {port: step.get(port) for port in self._ports.inputs}
        if None not in inputs.values() or all(
            inputs[port] is not None for port in interface.needed
        ):
            observation = interface.observe(inputs, step.index)
            return interface.messages(self._act(observation, inputs, step))
        absent = next(port for port in interface.needed if inputs[port] is None)
        self._waited += 1
        if self._waited > _LONGEST_WAIT:
            raise RunError(
                f"step {step.index}: input {absent!r} is still absent after {_LONGEST_WAIT} steps; "
                "leave it out with `observe`"
            )
        return {}


class LoadedPolicy(PolicyParticipant):
    """Decides by the function that its parameters name, or else `policy`."""

    def __init__(self, config: Config, policy: str = "") -> None:
        super().__init__(config, self._decide)
        name = policy or self.params.policy
        if not name:
            raise WiringError(
                "the recording names no policy; give one, e.g. stepbus replay run.mcap "
                f"--participant {config.name} --exec python -m stepbus_gym.policy "
                "my_policy:act"
            )
        self._policy = load_policy(name, [config.folder, _HERE])

    def _decide(self, observation: Vector, _inputs: Mapping[str, Any], step: Step) -> Vector:
        size = 0 if self.interface is None else len(self.interface.action)
        return checked_action(self._policy(observation), size, step.index)


def load_policy(name: str, folders: Sequence[Path]) -> Callable[[Vector], Any]:
    """Return the policy, a function of an observation, that `module:function` names.

    A class is made once. folders: searched before the installed modules. Raises WiringError for
    a name that leads to no function.
    """
    path = list(sys.path)
    try:
        sys.path[:0] = map(str, folders)
        loaded = pkgutil.resolve_name(name)
        policy: Callable[[Vector], Any] = loaded() if isinstance(loaded, type) else loaded
    except Exception as exc:
        where = " or ".join(map(str, folders))
        text = f"policy {name}: {error_text(exc)}; write module:function, of a module in {where}"
        raise WiringError(text) from exc
    finally:
        sys.path[:] = path
    if not callable(policy):
        raise WiringError(f"policy {name} is not a function; write module:function")
    return policy


def checked_action(action: Any, size: int, step: int) -> Vector:
    """Return an action as a vector; raises RunError for one of another form or not finite."""
    try:
        vector = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError) as exc:
        raise RunError(
            f"step {step}: the action is not a vector of numbers: {text_of(exc)}"
        ) from exc
    if vector.shape != (size,):
        raise RunError(f"step {step}: the action has shape {vector.shape}, not ({size},)")
    # Of a few numbers, this takes a tenth of what NumPy takes.
    if not all(map(math.isfinite, vector.tolist())):
        index = int(np.flatnonzero(~np.isfinite(vector))[0])
        raise RunError(f"step {step}: entry {index} of the action is {vector[index]}")
    return vector
