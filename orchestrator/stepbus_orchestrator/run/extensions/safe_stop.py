"""The safe stop: the run continues without a participant that has failed until all is at rest."""

import signal
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from stepbus_orchestrator.errors import ParticipantFault, RunFailure
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.descriptions import input_descriptions
from stepbus_orchestrator.run.kernel.state import RunPhase
from stepbus_orchestrator.run.player import Player
from stepbus_orchestrator.run.safe_messages import MOMENTARY, motion_at_end, safe_message
from stepbus_orchestrator.scenario.model import HoldSpec, ParticipantSpec
from stepbus_schemas import (
    SHIPPED,
    Decoder,
    Description,
    MessageError,
    Outputs,
    Types,
    encode,
    reached,
)

_decode_outputs = Decoder(Outputs)
_KILLED_S = 0.25
"""How long a killed process may take to be gone before its last reports are read [s]."""


class Substitute:
    """Replaces one participant when it has failed, from the first step that it owes.

    Until then it follows what the participant publishes: once the process is gone, nothing else
    knows what has reached its consumers.

    player: of the participant. log: gets the same bytes, as the orchestrator gets those of the
    participant's log. types: of the scenario.
    """

    def __init__(
        self,
        spec: ParticipantSpec,
        hold: HoldSpec,
        *,
        token: str,
        step_ns: int,
        player: Player,
        log: Callable[[bytes], None],
        types: Types = SHIPPED,
    ) -> None:
        self._types = types
        self._spec = spec
        self._hold = hold
        self._token = token
        self._step_ns = step_ns
        self._player = player
        self._log = log
        self._published: deque[tuple[int, bytes]] = deque()
        self._last: dict[str, Any] = {}
        self._safe: dict[str, bytes] = {}
        self._next = 0
        self._until = 0
        self._repeat_until = 0

    def take(self, data: bytes) -> None:
        """Store the outputs that the participant published; ignore those of other runs or steps."""
        try:
            outputs = _decode_outputs(data)
        except MessageError:
            return
        if outputs.token == self._token and outputs.step == self._next:
            self._published.append((outputs.step, data))
            self._last |= outputs.ports
            self._next += self._spec.every

    def forget(self, reported: int) -> None:
        """Forget the outputs that the log has reported, except the newest."""
        while len(self._published) > 1 and self._published[0][0] <= reported:
            self._published.popleft()

    def take_over(self, reported: int, descriptions: Mapping[str, Description]) -> tuple[int, int]:
        """Return the first step that is published from here, and the step before which it ends.

        reported: the newest step in the participant's log; later outputs are logged now, and all
        are published again for readers that they did not reach. descriptions: of its outputs.
        """
        for step, data in self._published:
            self._player.puts[self._spec.name](data)
            if step > reported:
                self._log(data)
        self._next = max(self._next, reported + self._spec.every)
        ports = [p for p, output in self._spec.outputs.items() if output.type not in MOMENTARY]
        self._last = {port: bytes(self._last[port]) for port in ports if port in self._last}
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
        self._safe = {port: encode(item) for port, item in messages.items() if item is not None}
        self._repeat_until = self._next + -(-self._hold.keep_ns // self._step_ns)
        self._until = self._repeat_until + -(-self._hold.hold_ns // self._step_ns)
        return self._next, self._until

    def publish_below(self, step_limit: int) -> None:
        """Publish the outputs of all steps below `step_limit`."""
        while self._next < min(step_limit, self._until):
            ports = self._last if self._next < self._repeat_until else self._safe
            data = self._player.publish(self._spec.name, self._next, ports)
            self._next += self._spec.every
            self._log(data)


class SafeStop(RunExtension):
    """Replaces the first participant with `on_fault: hold` that fails.

    replaced_steps: the first step that is not its own, and the step before which the run ends.
    """

    def __init__(self) -> None:
        self.replaced_steps = (0, 0)
        self._substitutes: dict[str, Substitute] = {}
        self._active: Substitute | None = None

    def attach(self, run: RunView) -> None:
        """Follow the participants that can be replaced: each message costs some microseconds."""
        super().attach(run)
        scenario, session = run.state.scenario, run.session
        for spec in scenario.participants:
            if spec.hold is None:
                continue
            self._substitutes[spec.name] = Substitute(
                spec,
                spec.hold,
                token=run.token,
                step_ns=scenario.step_ns,
                player=Player([spec], scenario.step_ns, run.token, session.publisher),
                log=partial(run.messages.take_outputs, spec.name),
                types=scenario.types,
            )
            take = session.inbox.into(partial(self._take, spec.name))
            session.bus.subscribe_content(f"out/{spec.name}", take)

    def _take(self, name: str, data: bytes) -> None:
        if self._active is None:
            self._substitutes[name].take(data)

    def turn(self) -> None:
        """Publish the released steps of the replaced participant."""
        if self._active is not None:
            self._active.publish_below(self.run.state.released)
            return
        for name, substitute in self._substitutes.items():
            substitute.forget(self.run.state.barrier.reported[name])

    def survive(self, failure: RunFailure) -> Callable[[], str] | None:
        """Replace the participant that failed for as long as the scenario says (`on_fault`)."""
        if not self._can_replace(failure):
            return None
        run, state = self.run, self.run.state
        participant = state.participants[failure.participant or ""]
        name = participant.name
        reached("a participant is replaced")
        state.enter(RunPhase.FALLBACK)
        participant.process.signal(signal.SIGKILL)
        participant.process.wait(_KILLED_S)
        state.replaced = name
        run.receive_last_reports(name)
        first, until = self._take_over(name)
        state.end = (until, f"{name} has failed; its commands were held")
        run.recorder.add_metadata(
            layout.FALLBACK_METADATA,
            {"participant": name, "first": str(first), "until": str(until)},
            before=first,
        )
        run.timing.event("hold", name, f"steps {first} to {until - 1}")
        run.observer.event("error", name, first, f"{failure}; holding until step {until}")
        return self._outcome

    def _can_replace(self, failure: RunFailure) -> bool:
        """Return whether the participant that failed can be replaced.

        After what cannot be recorded, safe messages would leave a hole. A witness that found a
        message of another malformed has ended itself (P8.1): then two are gone. A process that the
        user has started cannot be killed: while it may still publish, no other may in its name.
        """
        name = failure.participant or ""
        is_fault = isinstance(failure, ParticipantFault)
        has_witness = isinstance(failure, ParticipantFault) and failure.witness is not None
        is_handled = name in self._substitutes and not self.run.state.is_repeating
        if not is_handled or has_witness or self.run.recorder.has_broken(name):
            return False
        participant = self.run.state.participants[name]
        has_ended = participant.process.exit_code() is not None
        return participant.external is None or is_fault or has_ended

    def _take_over(self, name: str) -> tuple[int, int]:
        """Start the substitute of a participant whose process is gone; return `replaced_steps`."""
        state = self.run.state
        self._active = self._substitutes[name]
        inputs = input_descriptions(state.scenario, self.run.descriptions)
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

    def _outcome(self) -> str:
        """Return the end of the error message of a run that has come to its safe stop."""
        reached("a run comes to its safe stop")
        first, until = self.replaced_steps
        state = self.run.state
        rests = motion_at_end(state.scenario, self.run.descriptions, state.newest)
        return f"its commands were held from step {first} to {until} {rests}"
