"""Answers the calls of one participant (P15)."""

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from stepbus_participant.bus import Bus
from stepbus_participant.calls.methods import Method
from stepbus_schemas import (
    Call,
    Called,
    StepbusError,
    Welcome,
    encode,
    encoding_of,
    explained,
    text_of,
)


class Answers:
    """Answers each call once; a repeated call gets the same answer (P15.3).

    The orchestrator releases no step before the call is answered, so a call always happens between
    the same two steps (P15.2).
    """

    def __init__(self, methods: Mapping[str, Method], welcome: Welcome, bus: Bus) -> None:
        self._methods = dict(methods)
        self._name = welcome.name
        self._token = welcome.token
        self._max_bytes = welcome.max_outputs_bytes
        self._put = bus.publisher(f"called/{welcome.name}", encoding_of("Called/1"))
        self._newest_id = -1
        self._newest_answer = b""

    def answer(self, call: Call) -> None:
        """Run the method and publish its answer; ignore a call older than the newest one."""
        if call.id > self._newest_id:
            self._newest_id = call.id
            self._newest_answer = self._run(call)
        if call.id == self._newest_id:
            self._put(self._newest_answer)

    def _run(self, call: Call) -> bytes:
        method = self._methods.get(call.method)
        if method is None:
            known = ", ".join(self._methods) or "nothing"
            return self._pack(call, error=f"{self._name} offers {known}, not {call.method!r}")
        try:
            _signature(method.function).bind(*call.args)
            value = method.function(*call.args)
        except (ArithmeticError, LookupError, StepbusError, TypeError, ValueError) as exc:
            return self._pack(call, error=f"{call.method}: {text_of(exc)}")
        try:
            return self._pack(call, value=value)
        except (OverflowError, TypeError, ValueError) as exc:
            return self._pack(call, error=f"{call.method}: its answer {explained(exc)}")

    def _pack(self, call: Call, value: Any = None, error: str | None = None) -> bytes:
        answer = Called(name=self._name, token=self._token, id=call.id, value=value, error=error)
        data = encode(answer)
        if len(data) <= self._max_bytes:
            return data
        # The bus would lose it without a word, and the run would wait in vain (P3.7).
        why = (
            f"{call.method[:100]}: the answer takes {len(data)} bytes, over the {self._max_bytes} "
            "that the low-latency transport carries; set bus.low_latency: false"
        )
        return encode(msgspec.structs.replace(answer, value=None, error=why))


def _signature(function: Callable[..., Any]) -> inspect.Signature:
    """Return the parameters of a function; some built-in ones do not reveal theirs."""
    try:
        return inspect.signature(function)
    except ValueError:
        return inspect.Signature([inspect.Parameter("args", inspect.Parameter.VAR_POSITIONAL)])
