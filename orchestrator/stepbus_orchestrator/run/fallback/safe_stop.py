"""Emergency stop: the run goes on without the one that failed, until everything is at rest."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from stepbus_orchestrator.errors import ParticipantFault, RunFailure
from stepbus_orchestrator.recording import Descriptions
from stepbus_orchestrator.run.control.pace import FAR
from stepbus_orchestrator.run.kernel.messages import Intake, RunState
from stepbus_orchestrator.run.kernel.participants import input_descriptions
from stepbus_participant import Bus

from .substitute import StandIn


class Emergency:
    """Who can be stood in for, and whoever is being stood in for now.

    state: of the run. Only participants with `on_fault: hold` are listened to: to see every
    message costs a step some microseconds.
    """

    def __init__(self, state: RunState, bus: Bus, token: str, intake: Intake) -> None:
        self._state = state
        scenario = state.scenario
        self._stand_ins: Mapping[str, StandIn] = {
            spec.name: StandIn(
                spec,
                spec.on_fault,
                bus=bus,
                token=token,
                step_ns=scenario.step_ns,
                take=partial(intake.take_outputs, spec.name),
            )
            for spec in scenario.participants
            if spec.on_fault is not None
        }
        self._active: StandIn | None = None

    def hear(self, name: str, sample: Any) -> None:
        """Take in what one of those participants published."""
        if self._active is None:
            self._stand_ins[name].hear(sample)

    @property
    def names(self) -> tuple[str, ...]:
        """Return who can be stood in for."""
        return tuple(self._stand_ins)

    def follow(self, released: int) -> None:
        """Publish what is due below `released`, and forget what nobody will ask for."""
        if self._active is not None:
            self._active.publish_below(released)
            return
        for name, stand_in in self._stand_ins.items():
            stand_in.forget(self._state.barrier.reported[name])

    def can_handle(self, failure: RunFailure) -> bool:
        """Return whether a failure is one that somebody can be stood in for.

        Whoever found a message of another broken has ended itself: then two are gone.
        """
        seen_by_other = isinstance(failure, ParticipantFault) and failure.witness is not None
        return (
            self._state.phase == "stepping"
            and self._state.replaced is None
            and failure.participant in self._stand_ins
            and not seen_by_other
        )

    def begin(self, name: str, descriptions: Descriptions) -> tuple[int, int]:
        """Stand in for the participant that is to be replaced and whose process is gone.

        Return the first step that is not its own, and the one before which the run ends.
        """
        state = self._state
        self._active = self._stand_ins[name]
        read = input_descriptions(state.scenario, descriptions)
        ports = {
            item.port: read[spec.name][port]
            for spec in state.scenario.participants
            for port, item in spec.inputs.items()
            if item.source == name
        }
        first, until = self._active.take_over(state.barrier.reported[name], ports)
        last = FAR if state.scenario.steps is None else state.scenario.steps
        return first, min(until, last)
