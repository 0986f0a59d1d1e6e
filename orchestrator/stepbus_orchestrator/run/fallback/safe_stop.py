"""The safe stop: the run continues without a participant that has failed until all is at rest."""

from collections.abc import Mapping
from functools import partial

from stepbus_orchestrator.errors import ParticipantFault, RunFailure
from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.run.bus.session import Session
from stepbus_orchestrator.run.kernel.descriptions import input_descriptions
from stepbus_orchestrator.run.kernel.gates import FAR
from stepbus_orchestrator.run.kernel.messages import MessageHandler
from stepbus_orchestrator.run.kernel.phase import RunPhase
from stepbus_orchestrator.run.kernel.state import RunState

from .substitute import Substitute


class SafeStop:
    """The participants that can be replaced, and the one that is.

    replaced_steps: the first step that is not its own, and the one before which the run ends.
    Only those with `on_fault: hold` are followed: to take every message costs a step some
    microseconds.
    """

    def __init__(self, session: Session, state: RunState, messages: MessageHandler) -> None:
        self._state = state
        scenario = session.scenario
        self._substitutes: Mapping[str, Substitute] = {
            spec.name: Substitute(
                spec,
                spec.on_fault,
                token=session.token,
                step_ns=scenario.step_ns,
                put=session.announcer.publisher(f"out/{spec.name}", "Outputs/1"),
                log=partial(messages.take_outputs, spec.name),
                types=scenario.types,
            )
            for spec in scenario.participants
            if spec.on_fault is not None
        }
        self._active: Substitute | None = None
        self.replaced_steps = (0, 0)

    def take(self, name: str, data: bytes) -> None:
        """Take what one of those participants published."""
        if self._active is None:
            self._substitutes[name].take(data)

    @property
    def names(self) -> tuple[str, ...]:
        """Return who can be replaced."""
        return tuple(self._substitutes)

    def follow(self, released: int) -> None:
        """Publish what is due below `released`, and forget what nobody will need."""
        if self._active is not None:
            self._active.publish_below(released)
            return
        for name, substitute in self._substitutes.items():
            substitute.forget(self._state.barrier.reported[name])

    def can_handle(self, failure: RunFailure) -> bool:
        """Return whether the participant that failed can be replaced.

        A witness that found a message of another malformed has ended itself (P8.1): then two are
        gone. One that somebody else has started cannot be killed: where it may still publish,
        nobody else may in its name.
        """
        has_witness = isinstance(failure, ParticipantFault) and failure.witness is not None
        return (
            self._state.phase is RunPhase.STEPPING
            and not self._state.is_repeating
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

    def start(self, name: str, descriptions: Descriptions) -> tuple[int, int]:
        """Replace the participant of a name, whose process is gone; return `replaced_steps`."""
        state = self._state
        self._active = self._substitutes[name]
        inputs = input_descriptions(state.scenario, descriptions)
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
