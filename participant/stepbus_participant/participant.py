"""What a user writes: a participant, as a class that knows nothing of the bus."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from stepbus_schemas import Description, Message

from .calls import Method
from .config import Config
from .step import Step

PortType = str | type[Message]
"""A message type: its class, or its name such as `JointState/1`."""


class Participant:
    """Base of everything that takes part in a run; override what you need.

    Called in this order: `__init__`, `describe`, `start`, then at every step `output` (only where
    the scenario says `publishes: first`) and `update`, and `close` on every path at the end.

    inputs, outputs: port → message type, as a class or a name such as `JointState/1`, for a
    program that only works with certain ports; the orchestrator refuses it where the scenario
    differs. None: it takes what the scenario says.
    """

    inputs: ClassVar[Mapping[str, PortType] | None] = None
    outputs: ClassVar[Mapping[str, PortType] | None] = None

    def __init__(self, config: Config) -> None:
        self.config = config

    def describe(self) -> Mapping[str, Description]:
        """Return a description of each output: names, limits, units."""
        return {}

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Take in the descriptions of the inputs; the clock stands at zero."""

    def output(self, step: Step) -> Mapping[str, Message]:
        """Return what to publish before the inputs of this step are read, by output port.

        Also called once more after the last step, so that the recording ends with its result.
        """
        return {}

    def update(self, step: Step) -> Mapping[str, Message] | None:
        """Read the inputs of this step and return what to publish, by output port.

        With `publishes: first` the state moves on to the next step here, and nothing is returned.
        """
        return None

    def calls(self) -> Mapping[str, Method]:
        """Return what the participant can be asked between two steps, by name.

        `stepbus call RUN NAME VERB` asks it. A function that changes anything that a later step
        reads must say so: `Method(function, help, changes=True)`.
        """
        return {}

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the libraries that shape the result, for the recording."""
        return {}

    def close(self) -> None:
        """Give back what is held; called once, also after a fault."""
