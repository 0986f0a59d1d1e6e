"""The base class of your participants, which know nothing of the bus."""

from collections.abc import Mapping
from typing import ClassVar

from stepbus_schemas import Description, Message, RunError

from .calls.methods import Method
from .config import Config
from .step import Step

PortType = str | type[Message]
"""A message type: its class, or its name such as `JointState/1`."""


class Participant:
    """Base class of your participants; override what you need.

    Called in this order: `__init__`, `describe`, `start`, then at every step `output` (only with
    `publishes: first` in the scenario) and `update`, and finally `close`, on every path.

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
        """Use the descriptions of the inputs, before the first step."""

    def output(self, step: Step) -> Mapping[str, Message]:
        """Return output port → message, published before the inputs of this step are read.

        Called once more after the last step, so that the recording ends with its result.
        """
        return {}

    def update(self, step: Step) -> Mapping[str, Message] | None:
        """Read the inputs of this step, and return output port → message.

        With `publishes: first` the outputs of this step are already out: compute the state of the
        next step and return nothing; a message returned here ends the run with an error.
        """
        return None

    def calls(self) -> Mapping[str, Method]:
        """Return name → method that can be called between two steps.

        `stepbus call RUN NAME METHOD` calls it. Declare a method that changes anything a later
        step reads: `Method(function, help, changes=True)`.
        """
        return {}

    def save(self) -> bytes | None:
        """Return all that the next step depends on, beside its inputs; None where that is unknown.

        Called between two steps, where the scenario asks for checkpoints. What cannot be restored
        so that every later output is equal to the bit is None: a branch then starts at step 0.
        """
        return None

    def restore(self, state: bytes) -> None:
        """Take a state that `save` returned in another process; called once, after `start`.

        Raises RunError for one that does not fit.
        """
        raise RunError(f"{self.config.name} saves no state, so it can restore none")

    def versions(self) -> Mapping[str, str]:
        """Return library → version, of those that shape the result; the recording keeps them."""
        return {}

    def close(self) -> None:
        """Release resources; called once, also after a fault."""
