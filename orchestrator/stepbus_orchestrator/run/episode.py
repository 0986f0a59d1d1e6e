"""A run in one process whose steps our caller makes: it is one of the participants."""

import atexit
import dataclasses
import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import FrameType
from typing import Any, cast

from greenlet import getcurrent, greenlet

from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.run.extension import RunExtension, RunView
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.inprocess.heartbeat import TURN, Heartbeat
from stepbus_orchestrator.run.inprocess.local_run import LocalRun
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import Config, Participant, Step, StepsOver
from stepbus_participant.user_classes import imported
from stepbus_schemas import StepbusError, WiringError

from .extensions.debug import Debug

Make = Callable[[Config, Callable[[Step], Any]], Participant]
_END = object()


class Episode(RunExtension):
    """A run in one process, which waits at each step of one participant for its caller.

    The run is a greenlet of its own: `start` and `advance` let it work, in the thread of the
    caller, until the participant has the inputs of its next step. In between, the process is as
    its caller left it: signal handlers, working folder, `sys.path`, `sys.argv`, loaded modules.
    There is no deadline for the caller.

    scenario: checked; its duration counts for nothing. name: of the participant. make: returns
    it, from its configuration and a function: called by `update` with the step, it waits for the
    caller and returns its answer. out: a new folder. is_recorded: whether the run is recorded
    there; its logs are there in any case. memory: as of `InProcess`.

    step: the one that the participant waits at, or None. local: the run, once it is open.
    """

    local: LocalRun

    def __init__(
        self,
        scenario: Scenario,
        name: str,
        make: Make,
        out: Path,
        *,
        is_recorded: bool,
        memory: Heartbeat | None = None,
    ) -> None:
        self.name = name
        self.step: Step | None = None
        self._make = make
        self._out = out
        self._options = Options(
            out=out,
            host=InProcess(instead="an environment runs in one process", memory=memory),
            is_recorded=is_recorded,
            extensions=[self, Debug(no_deadline=[name])],
        )
        # No run branches from an episode.
        self._scenario = dataclasses.replace(scenario, checkpoint_steps=0)
        self._interrupt = threading.Event()
        self._greenlet = self._next = greenlet(self._work)
        self._caller = getcurrent()
        self._place = os.getpid(), threading.get_ident()
        self._is_waiting = False
        self._outcome: Result | BaseException | None = None

    @property
    def recording(self) -> Path:
        """Return the path of run.mcap."""
        return self._out / layout.RUN_FILE

    # --- the caller's side ----------------------------------------------------------------

    def start(self) -> Step:
        """Start the run; return the first step of the participant.

        Raises RunFailure where it ends before.
        """
        _ctrl_c.open(self)
        self._switch()
        return self._step()

    def advance(self, answer: Any) -> Step:
        """Answer the step that the participant waits at; return the next one.

        Raises RunFailure where the run ends before.
        """
        self._check()
        self._switch(answer)
        return self.step or self._step()

    def end(self, reason: str) -> Result:
        """End the run before the step that the participant waits at; harmless when repeated.

        Raises RunFailure where a participant does not end as it should.
        """
        if self._outcome is None:
            self._check()
            if self.local.state is not None and self.step is not None:
                self.local.state.ask_end(self.step.index, reason)
            self.local.enter()
            self._switch(_END)
        return self._ended()

    def abandon(self) -> None:
        """End the run if it goes on and can be ended from here; raises nothing of the run."""
        is_ours = (os.getpid(), threading.get_ident()) == self._place
        if self._outcome is None and self._is_waiting and is_ours:
            try:
                self.end("abandoned")
            except (RunFailure, OSError):
                return

    def _check(self) -> None:
        if threading.get_ident() != self._place[1]:
            raise WiringError("use an episode only in the thread that started it")
        if not self._is_waiting:
            raise WiringError("no episode is running: reset the environment first")

    def _switch(self, *answer: Any) -> None:
        """Run until the run needs us."""
        out, err, outer, caller = sys.stdout, sys.stderr, _ctrl_c.inside, getcurrent()
        if caller is not self._caller:
            self._caller = self._greenlet.parent = caller
        _ctrl_c.inside = self._interrupt
        try:
            self._next.switch(*answer)
        finally:
            _ctrl_c.inside = outer
            sys.stdout, sys.stderr = out, err
        if self._greenlet.dead:
            self.step = None
            _ctrl_c.close(self)
        if self._interrupt.is_set():
            self._interrupt.clear()
            raise KeyboardInterrupt

    def _step(self) -> Step:
        if self.step is None or self._greenlet.dead:
            result = self._ended()
            raise RunFailure(f"the run ended at step {result.steps}: {result.reason}")
        return self.step

    def _ended(self) -> Result:
        self.step = None
        if isinstance(self._outcome, BaseException):
            raise self._outcome
        if self._outcome is None:
            raise WiringError("the run has not ended")
        return self._outcome.check()

    # --- the run's side -------------------------------------------------------------------

    def attach(self, run: RunView) -> None:
        """Work for the participant where no other one can."""
        super().attach(run)
        self.local = cast("LocalRun", run.strategy)

    def start_options(self, spec: ParticipantSpec) -> Mapping[str, Any]:
        """Return what makes the participant."""
        return {"make": self._make_participant} if spec.name == self.name else {}

    def adapt(self, scenario: Scenario) -> Scenario:
        """Return the scenario without an end: the caller sees the outcome of the last step."""
        return dataclasses.replace(scenario, steps=None)

    def _work(self) -> None:
        try:
            self._outcome = run(self._scenario, self._options, interrupt=self._interrupt)
        except (StepbusError, OSError) as exc:
            self._outcome = exc

    def _make_participant(self, config: Config) -> Participant:
        local, state, hub = self.local, self.run.state, self.local.hub
        words, now_s = local.memory.words, time.monotonic

        def await_answer(step: Step) -> Any:
            """Give the thread to the caller until it answers a step; return the answer.

            The others go first, as far as they can. Where all that they execute is stepbus's, it
            does not matter in which folder.
            """
            while hub.give_turns():
                pass
            out, err, turn = sys.stdout, sys.stderr, words[TURN]
            self.step, self._next, self._is_waiting, words[TURN] = step, getcurrent(), True, 0
            left = now_s()
            local.leave()
            answer = self._caller.switch()
            if imported:
                local.enter()
            state.away_s += now_s() - left
            self._is_waiting, words[TURN] = False, turn
            sys.stdout, sys.stderr = out, err
            if answer is _END:
                raise StepsOver
            return answer

        return self._make(config, await_answer)


class _CtrlC:
    """Handles Ctrl-C as long as any episode is open: it comes after the step.

    To set a handler at each step would take as long as a step. inside: is set by Ctrl-C in a step.
    """

    def __init__(self) -> None:
        self.inside: threading.Event | None = None
        self.episodes: set[Episode] = set()
        self._before: Any = None

    def open(self, episode: Episode) -> None:
        if not self.episodes:
            self._before = signal.signal(signal.SIGINT, self._handle)
        self.episodes.add(episode)

    def close(self, episode: Episode) -> None:
        if episode in self.episodes:
            self.episodes.remove(episode)
            if not self.episodes and signal.getsignal(signal.SIGINT) == self._handle:
                signal.signal(signal.SIGINT, self._before)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self._before is signal.SIG_IGN:
            return
        if self.inside is not None:
            self.inside.set()
        elif callable(self._before):
            self._before(number, frame)
        else:
            raise KeyboardInterrupt


_ctrl_c = _CtrlC()


def collect_garbage() -> None:
    """Free what an episode has left, which refers to itself, before the next one begins.

    Else the next one grows old together with it, and at each fiftieth or so the collector looks
    through all objects of the process, which takes longer than three resets. Where others are
    open, it is those that would grow old.
    """
    if gc.isenabled() and not _ctrl_c.episodes:
        gc.collect(1)


@atexit.register
def _end_all() -> None:
    """End what was left open, so that no folder of it stays."""
    for episode in list(_ctrl_c.episodes):
        episode.abandon()
