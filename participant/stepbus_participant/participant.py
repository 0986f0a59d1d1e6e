"""The base class of participants, and the step that it receives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, TypeVar, overload

from stepbus_schemas import Description, Message, MessageError, RunError, WiringError, suggest

from .calls import Method
from .config import Config
from .inputs import Input

_M = TypeVar("_M", bound=Message)


class InputAbsent(RunError, LookupError):
    """An input was read before its source published anything."""


class StepsOver(RunError):
    """Raised by an `update` that takes no further step and waits for the end of the run.

    It publishes nothing for this step.
    """


class InvalidInput(RunError):
    """The content of an input cannot be used: the run ends and blames its source.

    port: name of the input. text: the problem.
    """

    def __init__(self, port: str, text: str) -> None:
        super().__init__(f"input {port!r}: {text}")
        self.port = port
        self.text = text


class UnknownInput(WiringError, KeyError):
    """The participant has no such input."""

    __str__ = Exception.__str__


class _Inputs(dict[str, Input]):
    """The inputs of a participant by name."""

    def __missing__(self, port: str) -> Input:
        raise UnknownInput(f"unknown input {port!r}{suggest(port, self)}")


class Step:
    """The time and inputs of one step.

    index: number of the step. t_ns: simulation time [ns].
    """

    def __init__(self, inputs: Mapping[str, Input], step_ns: int) -> None:
        self._inputs = _Inputs(inputs)
        self._step_ns = step_ns
        self.index = 0
        self.end_reason: str | None = None

    @property
    def t_ns(self) -> int:
        """Return the simulation time [ns]."""
        return self.index * self._step_ns

    @property
    def t(self) -> float:
        """Return the simulation time [s]."""
        return self.index * self._step_ns * 1e-9

    @overload
    def read(self, port: str) -> Any: ...
    @overload
    def read(self, port: str, cls: type[_M]) -> _M: ...
    def read(self, port: str, cls: type[Message] | None = None) -> Any:
        """Return the newest message of an input.

        Raises InputAbsent if its source has not published yet, WiringError if the scenario
        connects a type other than `cls`, InvalidInput if the message lacks a field that `cls`,
        such as `SensedJoints`, requires.
        """
        value: Any = self._inputs[port].value
        if cls is not None and type(value) is not cls:
            value = self.get(port, cls)
        if value is None:
            raise InputAbsent(
                f"step {self.index}: input {port!r} has no message yet; use step.get() if it may "
                "be absent"
            )
        return value

    @overload
    def get(self, port: str) -> Any: ...
    @overload
    def get(self, port: str, cls: type[_M]) -> _M | None: ...
    def get(self, port: str, cls: type[Message] | None = None) -> Any:
        """Return the newest message of an input, or None if there is none yet.

        Raises WiringError and InvalidInput like `read`.
        """
        value = self._inputs[port].value
        if cls is None or value is None or type(value) is cls:
            return value
        try:
            return self._inputs[port].read_as(cls)
        except MessageError as exc:
            raise InvalidInput(port, str(exc)) from exc

    def is_new(self, port: str) -> bool:
        """Return whether the input has a new message since the previous step."""
        return self._inputs[port].fresh

    def end(self, reason: str) -> None:
        """Request the end of the run once every participant has finished this step (P7.4).

        With `publishes: first`, a request from `update` is sent with the next outputs: the run
        ends after the next step of this participant.
        """
        self.end_reason = reason


PortType = str | type[Message]
"""A message type: its class, or its name such as `JointState/1`."""


class Participant:
    """Base class of your participants. Override the methods that you need.

    Order of the calls: `__init__`, `describe`, `start`; at every step `output` (only with
    `publishes: first` in the scenario) and `update`; finally, in every case, `close`.

    inputs, outputs: port → message type, as a class or a name such as `JointState/1`, for a
    program that requires certain ports; the orchestrator rejects a scenario with others. None: any
    ports.
    """

    inputs: ClassVar[Mapping[str, PortType] | None] = None
    outputs: ClassVar[Mapping[str, PortType] | None] = None

    def __init__(self, config: Config) -> None:
        self.config = config

    def describe(self) -> Mapping[str, Description]:
        """Return a description of each output: names, limits, units."""
        return {}

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Receive the descriptions of the inputs, before the first step."""

    def output(self, step: Step) -> Mapping[str, Message]:
        """Return output port → message, published before the inputs of this step are read.

        Called once more after the last step, so that the recording contains its result.
        """
        return {}

    def update(self, step: Step) -> Mapping[str, Message] | None:
        """Read the inputs of this step, and return output port → message.

        With `publishes: first`, the outputs of this step are already published: compute the state
        of the next step and return nothing. Returning a message ends the run with an error.
        """
        return None

    def calls(self) -> Mapping[str, Method]:
        """Return name → method that users can call between two steps.

        `stepbus call RUN NAME METHOD` calls it. For a method that changes anything a later step
        reads, use `Method(function, help, changes=True)`.
        """
        return {}

    def prepare_saves(self) -> None:
        """Do what takes long before step 0; called if the scenario requests checkpoints."""

    def save(self) -> bytes | None:
        """Return the state that the next step depends on, apart from its inputs; None if unknown.

        Called between two steps if the scenario requests checkpoints. Return None for a state that
        cannot be restored bit-exactly: a branch then starts at step 0.
        """
        return None

    def restore(self, state: bytes) -> None:
        """Restore a state that `save` returned in another process; called once, after `start`.

        Raises RunError for an incompatible state.
        """
        raise RunError(f"{self.config.name} does not save its state, so it cannot restore one")

    def versions(self) -> Mapping[str, str]:
        """Return library → version for the recording, for libraries that affect the result."""
        return {}

    def close(self) -> None:
        """Release resources; called once, also after a fault."""
