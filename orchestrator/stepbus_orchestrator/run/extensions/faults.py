"""Injected faults from outside: processes frozen, slowed down, killed or crashed at a step."""

import contextlib
import resource
import signal
from collections.abc import Mapping
from typing import Any

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.processes.child import Process
from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.scenario.faults import (
    MESSAGE_FAULTS,
    PROCESS_FAULTS,
    faults_of,
    format_fault,
)
from stepbus_orchestrator.scenario.model import FaultSpec, ParticipantSpec, Scenario
from stepbus_participant import MessageFault

_SLOW_HOLD_S = 0.008
_SLOW_RUN_S = 0.002


class Faults(RunExtension):
    """Injects the process faults of a scenario, each when all steps before its own are complete.

    Until then no participant is let into that step, so that the fault hits at this step and no
    other. Participants inject those on messages themselves.
    """

    def __init__(self) -> None:
        self._faults: list[FaultSpec] = []
        self._messages: list[FaultSpec] = []
        self._texts: list[str] = []
        self._held: list[_Held] = []

    def attach(self, run: RunView) -> None:
        """Take the faults of the run's scenario."""
        super().attach(run)
        self._faults = faults_of(run.state.scenario.faults, PROCESS_FAULTS)
        self._messages = faults_of(run.state.scenario.faults, MESSAGE_FAULTS)

    def start_options(self, spec: ParticipantSpec) -> Mapping[str, Any]:
        """Return the faults that a participant injects into its own messages."""
        return {"faults": message_faults(self.run.state.scenario, spec.name)}

    def ready(self) -> None:
        """Raise StartFailed when a fault cannot be injected into a participant's messages."""
        participants = self.run.state.participants
        for fault in self._messages:
            language = participants[fault.participant].language
            if language != "python":
                raise StartFailed(
                    (
                        f"before the first step: the fault '{format_fault(fault)}' needs a "
                        f"participant that uses the Python library; {fault.participant} is "
                        f"written in {language or 'an unknown language'}; "
                        f"{', '.join(PROCESS_FAULTS)} work for any language"
                    ),
                    participant=fault.participant,
                )

    def limit(self, released: int) -> int:
        """Return the step of the next fault, which must not be released before."""
        return self._faults[0].step if self._faults else FAR

    def act(self) -> None:
        """Inject what is due, as all steps below its own are complete."""
        completed, participants = self.run.state.barrier.completed, self.run.state.participants
        self._report_messages(completed)
        while self._faults and self._faults[0].step <= completed:
            fault = self._faults.pop(0)
            self._inject(fault, participants[fault.participant].process)
            self._injected(fault)

    def turn(self) -> None:
        """Stop and resume those that are frozen or slowed down."""
        now = self.run.clock.monotonic()
        self._held = [held for held in self._held if held.goes_on(now)]

    def wait_s(self, released: int, longest_s: float) -> float | None:
        """Return how long to wait until one is stopped or resumed [s]; None without any."""
        now = self.run.clock.monotonic()
        left = (held.changes_at - now for held in self._held)
        return min((max(0.0, min(each, longest_s)) for each in left), default=None)

    def _injected(self, fault: FaultSpec) -> None:
        text = format_fault(fault)
        self._texts.append(text)
        self.run.timing.event("fault injected", fault.participant, text)
        self.run.observer.event("warning", fault.participant, fault.step, f"fault injected: {text}")

    def result(self) -> Mapping[str, Any]:
        """Return the faults that were injected."""
        return {"faults": self._texts}

    def _report_messages(self, step: int) -> None:
        while self._messages and self._messages[0].step <= step:
            self._injected(self._messages.pop(0))

    def _inject(self, fault: FaultSpec, process: Process) -> None:
        lasts_s = (fault.duration_ns or 0) * 1e-9
        if fault.type == "freeze" and fault.duration_ns is None:
            process.signal(signal.SIGSTOP)
        elif fault.type in {"freeze", "slow"}:
            hold_s = _SLOW_HOLD_S if fault.type == "slow" else lasts_s
            self._held.append(_Held(process, self.run.clock.monotonic(), lasts_s, hold_s))
        else:
            _end(process, signal.SIGKILL if fault.type == "kill" else signal.SIGSEGV)

    def stopping(self) -> None:
        """Resume every process that is frozen or slowed down: each has to leave."""
        for held in self._held:
            held.process.signal(signal.SIGCONT)
        self._held = []

    def close(self) -> None:
        """Report the faults on the last messages."""
        self._report_messages(self.run.state.steps)
        self.stopping()


class _Held:
    """A process that is stopped for a time, or again and again: slowed down, it runs a fifth of it.

    now: when it begins [s]. lasts_s: how long in all. hold_s: how long at once.
    """

    def __init__(self, process: Process, now: float, lasts_s: float, hold_s: float) -> None:
        self.process = process
        self.changes_at = now + hold_s
        self._until = now + lasts_s
        self._hold_s = hold_s
        self._is_stopped = True
        process.signal(signal.SIGSTOP)

    def goes_on(self, now: float) -> bool:
        """Stop or resume the process, where it is time; return False once it is over."""
        if now >= self._until or self.process.exit_code() is not None:
            self.process.signal(signal.SIGCONT)
            return False
        if now >= self.changes_at:
            self._is_stopped = not self._is_stopped
            self.process.signal(signal.SIGSTOP if self._is_stopped else signal.SIGCONT)
            self.changes_at = now + (self._hold_s if self._is_stopped else _SLOW_RUN_S)
        return True


def message_faults(scenario: Scenario, name: str) -> list[MessageFault]:
    """Return the faults on the messages of one participant."""
    return [
        MessageFault(type=fault.type, step=fault.step, duration_s=(fault.duration_ns or 0) * 1e-9)
        for fault in scenario.faults
        if fault.participant == name and fault.type in MESSAGE_FAULTS
    ]


def _end(process: Process, number: int) -> None:
    """End a process by a signal, without a core file in the scenario's folder."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        resource.prlimit(process.pid, resource.RLIMIT_CORE, (0, 0))
    process.signal(number)
    process.wait(1.0)
