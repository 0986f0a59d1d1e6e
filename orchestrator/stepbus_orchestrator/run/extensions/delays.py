"""Delays participants at random, to bring races to light."""

import random
import signal
from collections.abc import Generator, Sequence

from stepbus_orchestrator.processes.child import Process
from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.kernel.participants import ParticipantState

_LONGEST_PAUSE_S = 0.02
_LONGEST_DELAY_S = 0.01


class Delays(RunExtension):
    """Stops every participant again and again for up to 10 ms, each at times of its own.

    SIGSTOP and SIGCONT come from outside: they work for a program in any language, hit it between
    any two instructions and cannot change its messages. So whatever changes in the recording is a
    race of the participant's own.

    seed: of the pauses and delays. count: how many delays there were.
    """

    def __init__(self, seed: Sequence[int]) -> None:
        self.count = 0
        self._seed = list(seed)
        self._due: dict[Generator[float], float] = {}

    def started(self, participant: ParticipantState) -> None:
        """Delay a participant from now on."""
        self._due[self._disturb(participant.process, len(self._due))] = 0.0

    def _disturb(self, process: Process, index: int) -> Generator[float]:
        """Stop and resume a process; yield how long it stays as it is [s]."""
        generator = random.Random(repr([*self._seed, index]))  # noqa: S311  (delays, no secret)
        while process.exit_code() is None:
            yield generator.uniform(0, _LONGEST_PAUSE_S)
            process.signal(signal.SIGSTOP)
            self.count += 1
            try:
                yield generator.uniform(0, _LONGEST_DELAY_S)
            finally:
                process.signal(signal.SIGCONT)

    def turn(self) -> None:
        """Stop and resume those whose time it is."""
        now = self.run.clock.monotonic()
        for plan, due_s in self._due.items():
            if now >= due_s:
                self._due[plan] = now + next(plan, float("inf"))

    def wait_s(self, released: int, longest_s: float) -> float | None:
        """Return how long to wait until one is stopped or resumed [s]."""
        left_s = min(self._due.values()) - self.run.clock.monotonic()
        return max(0.0, min(left_s, longest_s))

    def stopping(self) -> None:
        """Resume all: each has to leave."""
        for plan in self._due:
            plan.close()

    close = stopping
