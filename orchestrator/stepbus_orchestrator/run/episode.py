"""A run in one process whose steps our caller makes: it is one of the participants."""

import atexit
import dataclasses
import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, ClassVar

from greenlet import getcurrent, greenlet

from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario import Scenario
from stepbus_participant import Config, Participant, Queue, Step, StepsOver
from stepbus_schemas import StepbusError, WiringError

from .extensions.debug import Debug
from .extensions.hosted_caller import HostedCaller, Room

Make = Callable[[Config, Callable[[Step], Any]], Participant]
_END = object()


class Episode:
    """A run in one process, which waits at each step of one participant for its caller.

    The run is a greenlet of its own: `start` and `advance` let it work, in the thread of the
    caller, until the participant has the inputs of its next step. In between, the process is as
    its caller left it: signal handlers, working folder, `sys.path`, `sys.argv`, loaded modules.
    There is no deadline for the caller.

    scenario: checked; its duration counts for nothing. name: of the participant. make: returns
    it, from its configuration and a function: called by `update` with the step, it waits for the
    caller and returns its answer. out: a new folder. is_recorded: whether the run is recorded
    there; its logs are there in any case.

    step: the one that the participant waits at, or None. result: once the run is over.
    """

    _open: ClassVar[set["Episode"]] = set()
    _inside: ClassVar["Episode | None"] = None
    _handler: ClassVar[Any] = None

    def __init__(
        self,
        scenario: Scenario,
        name: str,
        make: Make,
        out: Path,
        *,
        is_recorded: bool,
    ) -> None:
        self.name = name
        self.step: Step | None = None
        self.result: Result | None = None
        self._make = make
        self._options = Options(
            out=out,
            host=InProcess(),
            is_recorded=is_recorded,
            extensions=[HostedCaller(self), Debug(no_deadline=[name])],
        )
        # Nobody branches from an episode.
        self._scenario = dataclasses.replace(scenario, checkpoint_steps=0)
        self._interrupt = threading.Event()
        self._run = greenlet(self._work)
        self._caller = getcurrent()
        self._thread = threading.get_ident()
        self._is_main = threading.current_thread() is threading.main_thread()
        self._pid = os.getpid()
        self._room: Room | None = None
        self._queue: Queue | None = None
        self._answer: Any = None
        self._is_waiting = False
        self._error: BaseException | None = None

    @property
    def recording(self) -> Path:
        """Return the path of run.mcap."""
        return self._options.out / layout.RUN_FILE

    @classmethod
    def left_open(cls) -> set["Episode"]:
        """Return the episodes of the main thread that have not ended."""
        return cls._open

    # --- the caller's side ----------------------------------------------------------------

    def start(self) -> Step:
        """Start the run; return the first step of the participant.

        Raises RunFailure where it ends before.
        """
        self._remember()
        self._switch()
        return self._step()

    def advance(self, answer: Any) -> Step:
        """Answer the step that the participant waits at; return the next one.

        Raises RunFailure where the run ends before.
        """
        self._check()
        self._answer = answer
        self._switch()
        return self._step()

    def end(self, reason: str) -> Result:
        """End the run before the step that the participant waits at; harmless when repeated.

        Raises RunFailure where a participant does not end as it should.
        """
        if self.result is None:
            self._check()
            if self._room is not None and self.step is not None:
                self._room.ask_end(self.step.index, reason)
            self._answer = _END
            self._switch()
        return self._ended()

    def abandon(self) -> None:
        """End the run if it goes on and can be ended from here; raises nothing of the run."""
        is_ours = (os.getpid(), threading.get_ident()) == (self._pid, self._thread)
        if self.result is None and self._error is None and self._is_waiting and is_ours:
            try:
                self.end("abandoned")
            except (RunFailure, OSError):
                return

    def _check(self) -> None:
        if threading.get_ident() != self._thread:
            raise WiringError("an episode belongs to the thread that started it")
        if not self._is_waiting:
            raise WiringError("no episode is under way: reset the environment first")

    def _switch(self) -> None:
        """Let the run work until it needs us."""
        self._caller = self._run.parent = getcurrent()
        outer, Episode._inside = Episode._inside, self
        try:
            self._run.switch()
        finally:
            Episode._inside = outer
        if self._run.dead:
            self.step = None
            self._forget()
        if self._interrupt.is_set():
            self._interrupt.clear()
            raise KeyboardInterrupt

    def _remember(self) -> None:
        """Take Ctrl-C, as long as any episode is open: to set a handler takes as long as a step."""
        if self._is_main:
            if not Episode._open:
                Episode._handler = signal.signal(signal.SIGINT, _take_interrupt)
            Episode._open.add(self)

    def _forget(self) -> None:
        if self in Episode._open:
            Episode._open.remove(self)
            if not Episode._open and signal.getsignal(signal.SIGINT) is _take_interrupt:
                signal.signal(signal.SIGINT, Episode._handler)

    @classmethod
    def take_interrupt(cls, number: int, frame: FrameType | None) -> None:
        """Let Ctrl-C reach the caller, behind the step that is being made."""
        if cls._handler is signal.SIG_IGN:
            return
        if cls._inside is not None:
            cls._inside._interrupt.set()
        elif callable(cls._handler):
            cls._handler(number, frame)
        else:
            raise KeyboardInterrupt

    def _step(self) -> Step:
        if self.step is None or self._run.dead:
            result = self._ended()
            raise RunFailure(f"the run ended at step {result.steps}: {result.reason}")
        return self.step

    def _ended(self) -> Result:
        self.step = None
        if self._error is not None:
            raise self._error
        if self.result is None:
            raise WiringError("the run goes on")
        return self.result.check()

    # --- the run's side -------------------------------------------------------------------

    def _work(self) -> None:
        try:
            self.result = run(self._scenario, self._options, interrupt=self._interrupt)
        except (StepbusError, OSError) as exc:
            self._error = exc

    def sit(self, room: Room) -> None:
        """Take what the run gives."""
        self._room = room
        self._queue = room.queue()

    def make(self, config: Config) -> Participant:
        """Return what takes part."""
        return self._make(config, self._await_answer)

    def _await_answer(self, step: Step) -> Any:
        """Wait, in the participant's turn, for what the caller answers a step with."""
        if self._queue is None:
            raise WiringError("no run has begun")
        self.step = step
        self._is_waiting = True
        answer = self._queue.get()  # no time-out: the caller steps when it likes
        if answer is _END:
            raise StepsOver
        return answer

    def away(self) -> bool:
        """Let the caller work, where the participant waits for it."""
        if not self._is_waiting or self._room is None or self._queue is None:
            return False
        left = time.monotonic()
        self._room.leave()
        self._caller.switch()
        self._room.enter(time.monotonic() - left)
        self._is_waiting = False
        self._queue.put(self._answer)
        return True


def _take_interrupt(number: int, frame: FrameType | None) -> None:
    Episode.take_interrupt(number, frame)


def _end_all() -> None:
    """End what was left open, so that no folder of it stays."""
    for episode in list(Episode.left_open()):
        episode.abandon()


atexit.register(_end_all)
