"""One step, as a participant sees it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar, overload

from stepbus_schemas import Message, MessageError, RunError, WiringError

from .hints.suggestions import suggest

if TYPE_CHECKING:
    from .session.inputs import Input

M = TypeVar("M", bound=Message)


class InputAbsent(RunError, LookupError):
    """An input was read before its source published for the first time."""


class StepsOver(RunError):
    """Raised by an `update` that takes no further step: the participant waits for the run's end.

    It has published nothing for this step.
    """


class InvalidInput(RunError):
    """What an input carries cannot be used: the run ends, and its source is to blame.

    port: name of the input. text: what is wrong with it.
    """

    def __init__(self, port: str, text: str) -> None:
        super().__init__(f"input {port!r}: {text}")
        self.port = port
        self.text = text


class UnknownInput(WiringError, KeyError):
    """A participant asks for an input that it does not have."""

    __str__ = Exception.__str__


class _Inputs(dict[str, "Input"]):
    """The inputs of a participant by name."""

    def __missing__(self, port: str) -> Input:
        raise UnknownInput(f"no input {port!r}{suggest(port, self)}")


class Step:
    """The inputs of one step, and its time.

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
    def read(self, port: str, cls: type[M]) -> M: ...
    def read(self, port: str, cls: type[Message] | None = None) -> Any:
        """Return the newest message of an input.

        Raises InputAbsent when its source has not published yet, WiringError when the scenario
        connects another type than `cls`, InvalidInput for a message without a field that `cls`
        requires, such as `SensedJoints`.
        """
        value: Any = self._inputs[port].value
        if cls is not None and type(value) is not cls:
            value = self.get(port, cls)
        if value is None:
            raise InputAbsent(
                f"step {self.index}: input {port!r} is still absent; use step.get() where it may be"
            )
        return value

    @overload
    def get(self, port: str) -> Any: ...
    @overload
    def get(self, port: str, cls: type[M]) -> M | None: ...
    def get(self, port: str, cls: type[Message] | None = None) -> Any:
        """Return the newest message of an input, or None while it is absent.

        Raises as `read`.
        """
        value = self._inputs[port].value
        if cls is None or value is None or type(value) is cls:
            return value
        try:
            return self._inputs[port].read_as(cls)
        except MessageError as exc:
            raise InvalidInput(port, str(exc)) from exc

    def is_new(self, port: str) -> bool:
        """Return whether the input has a message that was not there at the previous step."""
        return self._inputs[port].fresh

    def end(self, reason: str) -> None:
        """Ask for the run to end once everybody has finished this step (P7.4).

        With `publishes: first`, the request goes out with the next outputs: from `update`, the run
        ends after the next step of this participant.
        """
        self.end_reason = reason
