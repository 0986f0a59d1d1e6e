"""Injected faults from outside: processes frozen, slowed down, killed or crashed at a step."""

import contextlib
import resource
import signal
import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.participants import Process
from stepbus_orchestrator.scenario import (
    MESSAGE_FAULTS,
    PROCESS_FAULTS,
    FaultSpec,
    ParticipantSpec,
    Scenario,
    faults_of,
    format_fault,
)
from stepbus_participant import MessageFault

if TYPE_CHECKING:
    from stepbus_orchestrator.run.run import Run

_SLOW_HOLD_S = 0.008
_SLOW_RUN_S = 0.002
_JOIN_S = 1.0


class Faults(RunExtension):
    """Injects the process faults of a scenario, each when all steps before its own are complete.

    Until then no participant is let into that step, so that the fault hits at this step and no
    other. Participants inject those on messages themselves.
    """

    def __init__(self) -> None:
        self._faults: list[FaultSpec] = []
        self._messages: list[FaultSpec] = []
        self._texts: list[str] = []
        self._frozen: list[tuple[float, Process]] = []
        self._over = threading.Event()
        self._threads: list[threading.Thread] = []

    def attach(self, run: "Run") -> None:
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
                    f"before the first step: the fault '{format_fault(fault)}' needs a participant "
                    f"that uses the Python library; {fault.participant} is written in "
                    f"{language or 'an unnamed language'}; "
                    f"{', '.join(PROCESS_FAULTS)} work for any",
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
        self._thaw()

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
        if fault.type == "freeze":
            process.signal(signal.SIGSTOP)
            if fault.duration_ns is not None:
                self._frozen.append((self.run.clock.monotonic() + lasts_s, process))
        elif fault.type == "slow":
            thread = threading.Thread(target=self._slow_down, args=(process, lasts_s), daemon=True)
            thread.start()
            self._threads.append(thread)
        else:
            _end(process, signal.SIGKILL if fault.type == "kill" else signal.SIGSEGV)

    def _thaw(self) -> None:
        now = self.run.clock.monotonic()
        for until, process in self._frozen:
            if now >= until:
                process.signal(signal.SIGCONT)
        self._frozen = [item for item in self._frozen if now < item[0]]

    def _slow_down(self, process: Process, lasts_s: float) -> None:
        """Let a process run for a fifth of the time."""
        until = self.run.clock.monotonic() + lasts_s
        while (
            self.run.clock.monotonic() < until
            and not self._over.is_set()
            and process.exit_code() is None
        ):
            process.signal(signal.SIGSTOP)
            self._over.wait(_SLOW_HOLD_S)
            process.signal(signal.SIGCONT)
            self._over.wait(_SLOW_RUN_S)

    def close(self) -> None:
        """Resume every process that is frozen or slowed down."""
        self._report_messages(self.run.state.steps)
        self._over.set()
        for thread in self._threads:
            thread.join(_JOIN_S)
        for _, process in self._frozen:
            process.signal(signal.SIGCONT)
        self._frozen = []


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
