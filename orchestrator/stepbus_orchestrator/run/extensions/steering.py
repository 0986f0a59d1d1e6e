"""What a user asks of a run itself while it goes on: none of it changes a result."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.extensions.real_time import Speed
from stepbus_schemas import CallReply, WiringError

from .calls import Calls

_FACTORS = (1e-3, 1e3)
_PERIODS_S = (0.01, 1.0)
_MOST_STEPS = 1_000_000
FLUSHED_S = 10.0
"""For so long a call `flush` counts [s]."""


class Steering(RunExtension):
    """Answers calls that name no participant: status, pause, resume, step, speed, flush, stop.

    pace, speed: of the run. calls: gets them. real_time: factor of a run in real time.
    """

    def __init__(
        self, pace: Pace, speed: Speed, calls: Calls, real_time: float | None = None
    ) -> None:
        self._pace = pace
        self._speed = speed
        self._real_time = real_time
        calls.steer = self.take
        self._flush_s: float | None = None
        self._flush_until = 0.0
        self._flush_at = 0.0
        self._methods: Mapping[str, Callable[[Sequence[Any]], object]] = {
            "status": self._status,
            "pause": lambda _: pace.pause(),
            "resume": lambda _: pace.resume(),
            "step": self._step,
            "speed": self._set_speed,
            "flush": self._set_flush,
            "stop": self._stop,
        }

    def turn(self) -> None:
        """Write what is recorded as often as a live view of the run asks for, again and again."""
        if self._flush_s is None:
            return
        now = self.run.clock.monotonic()
        if now > self._flush_until:
            # The view that asked for it was killed.
            self._flush_s = None
        elif now >= self._flush_at:
            self._flush_at = now + self._flush_s
            self.run.recorder.flush()

    def take(self, method: str, args: Sequence[Any]) -> CallReply:
        """Do what is asked, and answer."""
        work = self._methods.get(method)
        if work is None:
            return CallReply(
                error=f"a run has no call {method!r}; it has {', '.join(self._methods)}"
            )
        try:
            value = work(args)
        except WiringError as exc:
            return CallReply(error=str(exc))
        self.run.state.is_release_due = True
        return CallReply(step=self.run.state.released, value=value)

    def _status(self, _: Sequence[Any]) -> dict[str, Any]:
        status = dataclasses.asdict(self.run.progress())
        return {
            **status,
            "speed": self._speed.factor,
            "real_time": self._real_time,
            "waited_us": self.run.state.waited_us(),
        }

    def _step(self, args: Sequence[Any]) -> None:
        count = args[0] if args else 1
        if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= _MOST_STEPS:
            raise WiringError(f"step [COUNT]: {count!r} is not a number of steps")
        self._pace.step(count)

    def _stop(self, _: Sequence[Any]) -> None:
        if self._pace.is_stopping:
            # A participant may hold the last step without a deadline.
            self.run.interrupt.set()
        self._pace.stop()

    def _set_speed(self, args: Sequence[Any]) -> None:
        factor = None if not args or args[0] is None else _number(args[0], _FACTORS, "speed")
        self._speed.set(factor, self.run.state.released)

    def _set_flush(self, args: Sequence[Any]) -> None:
        given = args[0] if args else None
        self._flush_s = None if given is None else _number(given, _PERIODS_S, "flush")
        self._flush_until = self.run.clock.monotonic() + FLUSHED_S


def _number(value: object, limits: tuple[float, float], what: str) -> float:
    low, high = limits
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise WiringError(f"{what}: {value!r} is not a number from {low:g} to {high:g}")
    return float(value)
