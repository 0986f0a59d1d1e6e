"""Faults from outside: processes frozen, slowed down, killed or crashed, or delayed at random."""

import contextlib
import random
import resource
import signal
from collections.abc import Generator, Mapping, Sequence
from typing import Any

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.processes.child import Process
from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.run.kernel.barrier import FAR
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.scenario.fault_texts import (
    MESSAGE_FAULTS,
    PROCESS_FAULTS,
    faults_of,
    format_fault,
)
from stepbus_orchestrator.scenario.model import FaultSpec, ParticipantSpec, Scenario
from stepbus_participant import Clock, MessageFault

_LONGEST_PAUSE_S = 0.02
_LONGEST_DELAY_S = 0.01
_SLOW_HOLD_S = 0.008
_SLOW_RUN_S = 0.002


class Stops(RunExtension):
    """Stops and resumes processes, each by a plan of its own.

    SIGSTOP and SIGCONT come from outside: they work for a program in any language, hit it between
    any two instructions and cannot change its messages.
    """

    def __init__(self) -> None:
        self._due: dict[Generator[float], float] = {}

    def follow(self, plan: Generator[float]) -> None:
        """Follow a plan: it stops and resumes a process, and yields how long that stays so [s]."""
        self._due[plan] = self.run.clock.monotonic() + next(plan, 0.0)

    def turn(self) -> None:
        """Stop and resume the processes whose time it is."""
        now = self.run.clock.monotonic()
        for plan in [plan for plan, due_s in self._due.items() if now >= due_s]:
            self._due[plan] = now + next(plan, FAR)
            if self._due[plan] >= FAR:
                del self._due[plan]

    def wait_s(self, released: int, longest_s: float) -> float | None:
        """Return how long to wait until a process is stopped or resumed [s]; None without any."""
        now = self.run.clock.monotonic()
        left = (due_s - now for due_s in self._due.values())
        return min((max(0.0, min(each, longest_s)) for each in left), default=None)

    def stopping(self) -> None:
        """Resume all: each has to leave."""
        for plan in self._due:
            plan.close()
        self._due = {}

    close = stopping


class Delays(Stops):
    """Stops every participant again and again for up to 10 ms, each at times of its own.

    Whatever changes in the recording is a race of the participant's own.

    seed: of the pauses and delays. count: how many delays there were.
    """

    def __init__(self, seed: Sequence[int]) -> None:
        super().__init__()
        self.count = 0
        self._seed = list(seed)

    def started(self, participant: ParticipantState) -> None:
        """Delay a participant from now on."""
        self.follow(self._disturb(participant.process, len(self._due)))

    def _disturb(self, process: Process, index: int) -> Generator[float]:
        generator = random.Random(repr([*self._seed, index]))  # noqa: S311  (delays, no secret)
        while process.exit_code() is None:
            yield generator.uniform(0, _LONGEST_PAUSE_S)
            self.count += 1
            yield from _stopped(process, generator.uniform(0, _LONGEST_DELAY_S))


class Faults(Stops):
    """Injects the process faults of a scenario, each when all steps before its own are complete.

    Until then no participant is let into that step, so that the fault hits at this step and no
    other. Participants inject those on messages themselves.
    """

    def __init__(self) -> None:
        super().__init__()
        self._faults: list[FaultSpec] = []
        self._messages: list[FaultSpec] = []
        self._texts: list[str] = []

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
            self.follow(_held(process, self.run.clock, lasts_s, hold_s))
        else:
            _end(process, signal.SIGKILL if fault.type == "kill" else signal.SIGSEGV)

    def close(self) -> None:
        """Report the faults on the last messages."""
        self._report_messages(self.run.state.steps)
        super().close()


def _held(process: Process, clock: Clock, lasts_s: float, hold_s: float) -> Generator[float]:
    """Stop a process for a time, or again and again: slowed down, it runs a fifth of it."""
    until_s = clock.monotonic() + lasts_s
    while clock.monotonic() < until_s and process.exit_code() is None:
        yield from _stopped(process, hold_s)
        yield _SLOW_RUN_S


def _stopped(process: Process, hold_s: float) -> Generator[float]:
    process.signal(signal.SIGSTOP)
    try:
        yield hold_s
    finally:
        process.signal(signal.SIGCONT)


def message_faults(scenario: Scenario, name: str) -> list[MessageFault]:
    """Return the faults on the messages of one participant."""
    return [
        MessageFault(type=fault.type, step=fault.step, duration_s=(fault.duration_ns or 0) * 1e-9)
        for fault in scenario.faults
        if fault.participant == name and fault.type in MESSAGE_FAULTS
    ]


def _end(process: Process, number: int) -> None:
    """End a process by a signal, without a core file in the scenario's folder."""
    # Process 0 would be this one; one on another host is unknown to the kernel here.
    with contextlib.suppress(ProcessLookupError, PermissionError):
        if process.pid:
            resource.prlimit(process.pid, resource.RLIMIT_CORE, (0, 0))
    process.signal(number)
    process.wait(1.0)
