"""The safe stop: the run continues without a participant that has failed until all is at rest."""

from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import msgspec

from stepbus_orchestrator.errors import ParticipantFault, RunFailure
from stepbus_orchestrator.run.extension import RunView
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.descriptions import input_descriptions
from stepbus_orchestrator.run.safe_messages import MOMENTARY, safe_message
from stepbus_orchestrator.scenario.model import HoldSpec, ParticipantSpec
from stepbus_schemas import SHIPPED, Decoder, Description, MessageError, Outputs, Types, encode

_decode_outputs = Decoder(Outputs)


class Substitute:
    """Replaces one participant when it has failed, from the first step that it owes.

    Until then it follows what the participant publishes: once the process is gone, nothing else
    knows what has reached its consumers.

    put: publishes on the participant's key. log: gets the same bytes, as the orchestrator gets
    those of the participant's log. types: of the scenario.
    """

    def __init__(
        self,
        spec: ParticipantSpec,
        hold: HoldSpec,
        *,
        token: str,
        step_ns: int,
        put: Callable[[bytes], None],
        log: Callable[[bytes], None],
        types: Types = SHIPPED,
    ) -> None:
        self._types = types
        self._spec = spec
        self._hold = hold
        self._token = token
        self._step_ns = step_ns
        self._put = put
        self._log = log
        self._published: deque[tuple[int, bytes]] = deque()
        self._last: Mapping[str, Any] = {}
        self._safe: Mapping[str, Any] = {}
        self._next = 0
        self._until = 0
        self._repeat_until = 0

    def take(self, data: bytes) -> None:
        """Take what was published on the participant's key; what is not its own is ignored."""
        try:
            outputs = _decode_outputs(data)
        except MessageError:
            return
        if outputs.token == self._token and outputs.step == self._next:
            self._published.append((outputs.step, data))
            self._last = {**self._last, **outputs.ports}
            self._next += self._spec.every

    def forget(self, reported: int) -> None:
        """Forget what has been reported in the log, but for the newest."""
        while len(self._published) > 1 and self._published[0][0] <= reported:
            self._published.popleft()

    def take_over(self, reported: int, descriptions: Mapping[str, Description]) -> tuple[int, int]:
        """Return the first step that is published from here, and the one the run ends before.

        reported: the newest step in the participant's log; what it published after that is logged
        now, and published again for those it did not reach. descriptions: of its outputs.
        """
        for step, data in self._published:
            self._put(data)
            if step > reported:
                self._log(data)
        self._next = max(self._next, reported + self._spec.every)
        ports = [p for p, output in self._spec.outputs.items() if output.type not in MOMENTARY]
        self._last = {port: self._last[port] for port in ports if port in self._last}
        self._safe = self._safe_messages(descriptions)
        self._repeat_until = self._next + -(-self._hold.keep_ns // self._step_ns)
        self._until = self._repeat_until + -(-self._hold.hold_ns // self._step_ns)
        return self._next, self._until

    def _safe_messages(self, descriptions: Mapping[str, Description]) -> dict[str, bytes]:
        messages = {
            port: safe_message(
                output.type,
                descriptions.get(port, Description()),
                self._hold.safe.get(port),
                self._last.get(port),
                self._types,
            )
            for port, output in self._spec.outputs.items()
        }
        return {port: encode(message) for port, message in messages.items() if message is not None}

    def publish_below(self, step_limit: int) -> None:
        """Publish what is due at all steps below `step_limit`."""
        while self._next < min(step_limit, self._until):
            ports = self._last if self._next < self._repeat_until else self._safe
            outputs = Outputs(
                token=self._token,
                step=self._next,
                t_ns=self._next * self._step_ns,
                ports={port: msgspec.Raw(bytes(data)) for port, data in ports.items()},
            )
            data = encode(outputs)
            self._put(data)
            self._next += self._spec.every
            self._log(data)


class SafeStop:
    """The participants that can be replaced, and the one that is.

    replaced_steps: the first step that is not its own, and the one before which the run ends.
    Only those with `on_fault: hold` are followed: to take every message costs a step some
    microseconds.
    """

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._state = run.state
        scenario = run.state.scenario
        self._substitutes: Mapping[str, Substitute] = {
            spec.name: Substitute(
                spec,
                spec.hold,
                token=run.token,
                step_ns=scenario.step_ns,
                put=run.session.publisher(f"out/{spec.name}", "Outputs/1"),
                log=partial(run.messages.take_outputs, spec.name),
                types=scenario.types,
            )
            for spec in scenario.participants
            if spec.hold is not None
        }
        self._active: Substitute | None = None
        self.replaced_steps = (0, 0)

    def take(self, name: str, data: bytes) -> None:
        """Take what one of those participants published."""
        if self._active is None:
            self._substitutes[name].take(data)

    @property
    def followed(self) -> Mapping[str, Callable[[bytes], None]]:
        """Return the participants that can be replaced, and what gets what they publish."""
        return {name: partial(self.take, name) for name in self._substitutes}

    def follow(self, released: int) -> None:
        """Publish what is due below `released`, and forget what will not be needed."""
        if self._active is not None:
            self._active.publish_below(released)
            return
        for name, substitute in self._substitutes.items():
            substitute.forget(self._state.barrier.reported[name])

    def can_handle(self, failure: RunFailure) -> bool:
        """Return whether the participant that failed can be replaced.

        A witness that found a message of another malformed has ended itself (P8.1): then two are
        gone. One that the user has started cannot be killed: where it may still publish,
        no other process may in its name.
        """
        has_witness = isinstance(failure, ParticipantFault) and failure.witness is not None
        return (
            not self._state.is_repeating
            and failure.participant in self._substitutes
            and not has_witness
            and not self._may_publish(failure)
        )

    def _may_publish(self, failure: RunFailure) -> bool:
        """Return whether an external participant has failed that is still on the bus."""
        participant = self._state.participants[failure.participant or ""]
        has_ended = participant.process.exit_code() is not None
        has_given_up = isinstance(failure, ParticipantFault)
        return participant.external is not None and not (has_ended or has_given_up)

    def start(self, name: str) -> tuple[int, int]:
        """Replace the participant of a name, whose process is gone; return `replaced_steps`."""
        state = self._state
        self._active = self._substitutes[name]
        inputs = input_descriptions(state.scenario, self._run.descriptions)
        ports = {
            item.port: inputs[spec.name][port]
            for spec in state.scenario.participants
            for port, item in spec.inputs.items()
            if item.source == name
        }
        first, until = self._active.take_over(state.barrier.reported[name], ports)
        last = FAR if state.scenario.steps is None else state.scenario.steps
        self.replaced_steps = (first, min(until, last))
        return self.replaced_steps
