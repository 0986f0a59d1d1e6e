"""`stepbus play`: a recording, at the user's rate, to a participant in the user's debugger."""

import dataclasses
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import closing
from pathlib import Path

from stepbus_orchestrator.cli.commands import Play
from stepbus_orchestrator.cli.compare import replayed, tolerance_of
from stepbus_orchestrator.cli.interrupts import interruptible
from stepbus_orchestrator.cli.repeat import check_trust
from stepbus_orchestrator.cli.run_command import step_of
from stepbus_orchestrator.cli.terminal.keys import HELP, controlled, has_terminal
from stepbus_orchestrator.cli.terminal.live import Display
from stepbus_orchestrator.cli.terminal.output import Answer, has_screen
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay import replay
from stepbus_orchestrator.replay.trust import find_source
from stepbus_orchestrator.run.extensions.debug import Debug
from stepbus_orchestrator.run.extensions.external import External
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.extensions.real_time import Speed
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.run.kernel.state import RunPhase
from stepbus_orchestrator.run.reports import Observer, Progress
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_schemas import WiringError

_PATIENCE_S = 5.0
"""Who holds a step for longer than that is named."""


class Playing(Speed, Observer):
    """Holds the steps of a play by the wall clock, and shows what the participant makes of them.

    given: which steps, and how fast. pace: may end it. display: shows it.
    """

    def __init__(self, given: Play, pace: Pace, display: Display) -> None:
        super().__init__(step_ns=0)
        self._given, self._pace, self._display = given, pace, display
        self._shown, self._held, self._held_at = "", -1, 0.0
        self._lines: Callable[[], list[str]] | None = None

    def prepare(self, scenario: Scenario) -> Scenario:
        """Make it shorter, and one step at a time; raises WiringError where none is left."""
        step_ns, steps = scenario.step_ns, scenario.steps or 0
        self._step_ns, self._first = step_ns, step_of(self._given.begin, step_ns) or 0
        end = min(step_of(self._given.end or str(steps), step_ns) or 0, steps)
        if self._first >= end:
            raise WiringError(f"no step from {self._first} to {end}: the recording has {steps}")
        return dataclasses.replace(scenario, window=1, batch=1, steps=end)

    def awaiting(self, participants: Iterable[ParticipantState]) -> None:
        """Interrupt it where the user stops it before its participant, for whom it waits, joins."""
        if self._pace.is_stopping and self.run.state.phase is RunPhase.START_UP:
            self.run.interrupt.set()

    def limit(self, released: int) -> int:
        """Return the first step whose time has not come."""
        if self.factor is None and released >= self._first:
            self.set(self._given.rate, released)
        return super().limit(released)

    def compared(self, step: int, lines: Callable[[], list[str]]) -> None:
        """Keep a step, until it is shown or another one comes."""
        if step >= self._first:
            self._step, self._lines = step, lines

    def event(self, level: str, who: str, step: int, text: str) -> None:
        """Show an event."""
        self._display.event(level, who, step, text)

    def progress(self, progress: Progress) -> None:
        """Show how far it is; name the participant once where it holds a step for long."""
        now, held = time.monotonic(), progress.step if progress.holders else -1
        if held != self._held:
            self._held, self._held_at = held, now
        elif held >= 0 and now - self._held_at > _PATIENCE_S:
            self._held_at = float("inf")
            text = "has not published this step yet; is it in a debugger? There is no deadline"
            self.event("waiting", self._given.participant, held, text)
        if self._lines is not None:
            when = f"step {self._step}, {self._step * self._step_ns * 1e-9:g} s: "
            self._shown, self._lines = "\n".join(when + line for line in self._lines()), None
            if not has_screen(sys.stdout):
                self._display.say(self._shown)
        reached = self._display.reached(progress)
        note = self._shown if has_screen(sys.stdout) and self._shown else reached.note
        self._display.show(dataclasses.replace(reached, note=note))


def play_command(given: Play) -> Answer:
    """Play a recording to a participant, and return how its outputs differ."""
    recording, name, pace = Recording(given.recording), given.participant, Pace()
    source = find_source(recording, given.source)
    if source is None:
        check_trust(recording, name, trust=given.trust)
    ticket = given.ticket or Path(f"{name}.ticket")
    display = Display(sys.stdout, f"play to {name}", below=HELP if has_terminal() else "")
    playing = Playing(given, pace, display)
    with closing(display), interruptible() as interrupt, controlled(pace, interrupt):
        result = replay(
            recording.path,
            name,
            tolerance=tolerance_of(given.tolerances, name),
            set=given.set,
            recorded=source is None,
            source=source,
            observer=playing,
            interrupt=interrupt,
            extensions=[pace, playing, External({name: ticket}), Debug(no_deadline=[name])],
        )
    if not result.steps:
        lines = [f"stopped before {name} made a step: nothing was compared"]
        return Answer(None, lines, code=ExitCode.INTERRUPTED)
    return Answer(None, replayed(result), code=0 if result.equal else ExitCode.DIFFERENT)
