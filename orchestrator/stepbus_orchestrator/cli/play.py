"""`stepbus play`: a recording, at the user's rate, to a participant in the user's debugger."""

import contextlib
import dataclasses
import sys
import time
from collections.abc import Callable
from functools import partial
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
from stepbus_orchestrator.run.reports import Observer, Progress
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_schemas import WiringError

_LINES_EVERY_S = 0.1
_PATIENCE_S = 5.0
"""Who holds a step for longer than that is named."""


class Part(Speed):
    """Holds steps by the wall clock from one step on, and ends before another.

    given: names them, and the rate. first: the one step.
    """

    first = 0

    def __init__(self, given: Play) -> None:
        super().__init__(step_ns=0)
        self._given = given

    def prepare(self, scenario: Scenario) -> Scenario:
        """Make it shorter, and one step at a time; raises WiringError where none is left."""
        step_ns, steps = scenario.step_ns, scenario.steps or 0
        self._step_ns, self.first = step_ns, step_of(self._given.begin, step_ns) or 0
        end = step_of(self._given.end, step_ns)
        end = steps if end is None else min(end, steps)
        if self.first >= end:
            raise WiringError(f"no step from {self.first} to {end}: the recording has {steps}")
        return dataclasses.replace(scenario, window=1, batch=1, steps=end)

    def when(self, step: int) -> str:
        """Return a step and its time."""
        return f"step {step}, {step * self._step_ns * 1e-9:g} s"

    def limit(self, released: int) -> int:
        """Return the first step whose time has not come."""
        if self.factor is None and released >= self.first:
            self.set(self._given.rate, released)
        return super().limit(released)


class Beside(Observer):
    """Shows the outputs of a participant beside the recorded ones, and what a play waits for.

    participant: its name. part: which steps are shown.
    """

    def __init__(self, display: Display, participant: str, part: Part) -> None:
        self._display, self._participant, self._part = display, participant, part
        self._shown, self._due_at = "", 0.0
        self._newest: Callable[[], None] | None = None
        self._held, self._held_at = -1, 0.0

    def compared(self, step: int, lines: Callable[[], list[str]]) -> None:
        """Show a step; soon, where another has been shown just now."""
        if step >= self._part.first:
            self._newest = partial(self._show, step, lines)
            if time.monotonic() >= self._due_at:
                self._newest()

    def _show(self, step: int, lines: Callable[[], list[str]]) -> None:
        shown = [f"{self._part.when(step)}: {line}" for line in lines()]
        self._due_at = time.monotonic() + len(shown) * _LINES_EVERY_S
        self._shown, self._newest = "\n".join(shown), None
        if not has_screen(sys.stdout):
            self._display.say(self._shown)

    def event(self, level: str, who: str, step: int, text: str) -> None:
        """Show what is said of the play."""
        self._display.event(level, who, step, text)

    def progress(self, progress: Progress) -> None:
        """Show how far it is; name the participant once where it holds a step for long."""
        now, held = time.monotonic(), progress.step if progress.holders else -1
        if held != self._held:
            self._held, self._held_at = held, now
        elif held >= 0 and now - self._held_at > _PATIENCE_S:
            self._held_at = float("inf")
            text = "has not published this step yet; is it in a debugger? There is no deadline"
            self.event("waiting", self._participant, held, text)
        if self._newest is not None:
            self._newest()
        reached = self._display.reached(progress)
        is_shown = has_screen(sys.stdout) and self._shown
        note = self._shown if is_shown else reached.note
        self._display.show(dataclasses.replace(reached, note=note))


def play_command(given: Play) -> Answer:
    """Play a recording to a participant, and return how its outputs differ."""
    recording, name = Recording(given.recording), given.participant
    source = find_source(recording, given.source)
    if source is None:
        check_trust(recording, name, trust=given.trust)
    ticket, pace, part = given.ticket or Path(f"{name}.ticket"), Pace(), Part(given)
    display = Display(sys.stdout, f"play to {name}", below=HELP if has_terminal() else "")
    with (
        contextlib.closing(display),
        interruptible() as interrupt,
        controlled(pace, interrupt),
    ):
        result = replay(
            recording.path,
            name,
            tolerance=tolerance_of(given.tolerances, name),
            set=given.set,
            recorded=source is None,
            source=source,
            observer=Beside(display, name, part),
            interrupt=interrupt,
            extensions=[
                pace,
                part,
                External({name: ticket}),
                Debug(no_deadline=[name]),
            ],
        )
    code = ExitCode.FINISHED if result.equal else ExitCode.DIFFERENT
    return Answer(value=None, lines=replayed(result), code=code)
