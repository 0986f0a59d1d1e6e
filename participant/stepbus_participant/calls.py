"""What a participant can be asked between two steps, and how it answers."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from stepbus_schemas import (
    Call,
    CallDescription,
    Called,
    StepbusError,
    Welcome,
    encode,
    encoding_of,
)

from .bus import Bus


class CallError(StepbusError, ValueError):
    """A call cannot be answered; nothing was done."""


@dataclass(frozen=True)
class Method:
    """Something a participant can be asked.

    function: gets the arguments as they were given (numbers, texts, lists, maps) and returns
    anything MessagePack has; raises CallError, before it changes anything, when it cannot.
    help: arguments and answer in one line. changes: whether a later step may depend on it.
    """

    function: Callable[..., Any]
    help: str
    changes: bool = False

    @property
    def description(self) -> CallDescription:
        """Return what others get to know of it."""
        return CallDescription(help=self.help, changes=self.changes)


class Answers:
    """Answers the calls of one participant, each once; one that is repeated gets the same answer.

    The orchestrator lets nobody into a step before the call is answered, so that it is always done
    between the same two steps.
    """

    def __init__(self, methods: Mapping[str, Method], welcome: Welcome, bus: Bus) -> None:
        self._methods = dict(methods)
        self._name = welcome.name
        self._token = welcome.token
        self._put = bus.publisher(f"called/{welcome.name}", encoding_of("Called/1"))
        self._newest = -1
        self._said = b""

    def answer(self, call: Call) -> None:
        """Do what is asked, and say what came of it."""
        if call.id > self._newest:
            self._newest = call.id
            self._said = self._do(call)
        if call.id == self._newest:
            self._put(self._said)

    def _do(self, call: Call) -> bytes:
        method = self._methods.get(call.method)
        if method is None:
            known = ", ".join(self._methods) or "nothing"
            return self._pack(call, error=f"{self._name} can be asked {known}, not {call.method!r}")
        try:
            _signature(method.function).bind(*call.args)
            return self._pack(call, value=method.function(*call.args))
        except (ArithmeticError, LookupError, StepbusError, TypeError, ValueError) as exc:
            return self._pack(call, error=f"{call.method}: {exc}")

    def _pack(self, call: Call, value: Any = None, error: str | None = None) -> bytes:
        answer = Called(name=self._name, token=self._token, id=call.id, value=value, error=error)
        return encode(answer)


def _signature(function: Callable[..., Any]) -> inspect.Signature:
    """Return the parameters of a function; of some built-in ones nobody knows them."""
    try:
        return inspect.signature(function)
    except ValueError:
        return inspect.Signature([inspect.Parameter("args", inspect.Parameter.VAR_POSITIONAL)])
