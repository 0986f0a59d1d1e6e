"""What a participant offers to be called between two steps."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from stepbus_schemas import CallDescription, StepbusError


class CallError(StepbusError, ValueError):
    """A call cannot be answered; nothing was done."""


@dataclass(frozen=True)
class Method:
    """One method of a participant that `stepbus call` can call.

    function: takes the arguments as given (numbers, strings, lists, maps) and returns anything
    MessagePack has; raises CallError, before it changes anything, when it cannot. help: arguments
    and answer in one line. changes: whether a later step may depend on it.
    """

    function: Callable[..., Any]
    help: str
    changes: bool = False

    @property
    def description(self) -> CallDescription:
        """Return what `Ready` publishes about it."""
        return CallDescription(help=self.help, changes=self.changes)
