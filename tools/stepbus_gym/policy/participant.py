"""A policy as a participant."""

from collections.abc import Callable, Mapping
from typing import Any

from stepbus_gym.interface import Interface, PortTypes, Vector, described_outputs
from stepbus_participant import Config, Participant, Step
from stepbus_schemas import Description, Message, RunError

from .params import Params

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
        self._ports = PortTypes(
            inputs={port: row.type for port, row in config.inputs.items()},
            outputs={port: row.type for port, row in config.outputs.items()},
            types=config.types,
        )

    def describe(self) -> Mapping[str, Description]:
        """Return the joints that the policy commands."""
        return described_outputs(self._ports, self.params)

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Lay out observation and action."""
        self.interface = Interface(self._ports, self.params, inputs)

    def update(self, step: Step) -> Mapping[str, Message]:
        """Return the messages of the policy's action."""
        interface = self.interface
        if interface is None:
            raise RunError("the run has not started")
        inputs = {port: step.get(port) for port in self._ports.inputs}
        for port in interface.needed:
            if inputs[port] is None:
                return self._wait(step, port)
        observation = interface.observe(inputs, step.index)
        return interface.messages(self._act(observation, inputs, step))

    def _wait(self, step: Step, port: str) -> Mapping[str, Message]:
        self._waited += 1
        if self._waited > _LONGEST_WAIT:
            raise RunError(
                f"step {step.index}: input {port!r} is still absent after {_LONGEST_WAIT} steps; "
                "leave it out with `observe`"
            )
        return {}
