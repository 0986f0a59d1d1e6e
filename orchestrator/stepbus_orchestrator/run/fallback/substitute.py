"""Stands in for a participant that has failed: its last messages, then safe ones, then the end."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from stepbus_orchestrator.scenario import HoldSpec, ParticipantSpec
from stepbus_participant import Bus
from stepbus_schemas import (
    BaseCommand,
    Decoder,
    Description,
    Goal,
    JointCommand,
    JointReference,
    Message,
    MessageError,
    Outputs,
    Plan,
    encode,
    encoding_of,
    message_class,
)

_decode_outputs = Decoder(Outputs)

_NEWS = (
    "ControllerStatus/1",
    "Detections/1",
    "Event/1",
    "GoalStatus/1",
    "Image/1",
    "Plan/1",
    "PlanRequest/1",
)
"""Types that tell of a moment; to repeat them would be a lie."""

_NO_PLANNER = Plan(id=0, cause="planner_failed", text="the planner has failed")
"""What is true of every request from then on."""


class StandIn:
    """Publishes for one participant when it has failed, from the first step that it owes.

    While all is well it listens to what the participant publishes: of a process that is gone,
    nobody else knows what has reached its consumers. take: gets the messages it publishes, as the
    orchestrator gets those of the log.
    """

    def __init__(
        self,
        spec: ParticipantSpec,
        hold: HoldSpec,
        *,
        bus: Bus,
        token: str,
        step_ns: int,
        take: Callable[[bytes], None],
    ) -> None:
        self._spec = spec
        self._hold = hold
        self._bus = bus
        self._token = token
        self._step_ns = step_ns
        self._take = take
        self._put = bus.publisher(f"out/{spec.name}", encoding_of("Outputs/1"))
        self._heard: deque[tuple[int, bytes]] = deque()
        self._last: Mapping[str, Any] = {}
        self._safe: Mapping[str, Any] = {}
        self._next = 0
        self._until = 0
        self._keep_until = 0

    def hear(self, sample: Any) -> None:
        """Take in what the participant published; what is not its own is left to others."""
        data = self._bus.payload(sample)
        try:
            outputs = _decode_outputs(data)
        except MessageError:
            return
        if outputs.token == self._token and outputs.step == self._next:
            self._heard.append((outputs.step, data))
            self._last = {**self._last, **outputs.ports}
            self._next += self._spec.every

    def forget(self, reported: int) -> None:
        """Forget what the orchestrator has got from the log, but for the newest."""
        while len(self._heard) > 1 and self._heard[0][0] <= reported:
            self._heard.popleft()

    def take_over(self, reported: int, descriptions: Mapping[str, Description]) -> tuple[int, int]:
        """Begin to stand in; return the first step it publishes, and the one the run ends before.

        reported: the newest step in the log; what was published after it is logged now, and sent
        once more, for those it did not reach. descriptions: of the outputs.
        """
        for step, data in self._heard:
            self._put(data)
            if step > reported:
                self._take(data)
        self._next = max(self._next, reported + self._spec.every)
        ports = [p for p, output in self._spec.outputs.items() if output.type not in _NEWS]
        self._last = {port: self._last[port] for port in ports if port in self._last}
        self._safe = {
            port: encode(message)
            for port in self._spec.outputs
            if (message := self._safe_message(port, descriptions.get(port, Description())))
        }
        self._keep_until = self._next + -(-self._hold.keep_ns // self._step_ns)
        self._until = self._keep_until + -(-self._hold.hold_ns // self._step_ns)
        return self._next, self._until

    def publish_below(self, step_limit: int) -> None:
        """Publish what is due at all steps below `step_limit`."""
        while self._next < min(step_limit, self._until):
            ports = self._last if self._next < self._keep_until else self._safe
            outputs = Outputs(
                token=self._token,
                step=self._next,
                t_ns=self._next * self._step_ns,
                ports={port: msgspec.Raw(bytes(data)) for port, data in ports.items()},
            )
            data = encode(outputs)
            self._put(data)
            self._next += self._spec.every
            self._take(data)

    def _safe_message(self, port: str, description: Description) -> Message | None:
        """Return the message that brings to rest whoever reads a port; None: nothing to say."""
        kind = self._spec.outputs[port].type
        cls = message_class(kind)
        given = self._hold.safe.get(port)
        if given is not None:
            return msgspec.convert(given, cls)
        if kind in _NEWS:
            return _NO_PLANNER if cls is Plan else None
        if cls is JointCommand:
            return JointCommand(mode="brake", values=[0.0] * len(description.names))
        if cls is BaseCommand:
            return BaseCommand()
        raw = self._last.get(port)
        return _safer(Decoder(cls)(raw)) if raw is not None else None


def _safer(last: Message) -> Message:
    """Return what comes to rest after the last message of a port."""
    if isinstance(last, Goal):
        # Ids of goals are the sender's own; the next one ends the goal under way.
        return Goal(id=last.id + 1, type="stop")
    if isinstance(last, JointReference):
        still = [0.0] * len(last.position)
        return JointReference(position=last.position, velocity=still, acceleration=still)
    return last
