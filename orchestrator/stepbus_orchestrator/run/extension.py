"""The seams of a run: what an extension may do in it, and the host on which it takes place."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol

from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.processes.slots import RunSlots
from stepbus_orchestrator.recording import Descriptions, Sink, TimingRecorder
from stepbus_orchestrator.run.bus import Session
from stepbus_orchestrator.run.kernel.barrier import FAR, Gate
from stepbus_orchestrator.run.kernel.messages import MessageHandler
from stepbus_orchestrator.run.kernel.participants import ParticipantState
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_orchestrator.run.reports import Observer, Progress
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import Bus, Clock, Disk
from stepbus_schemas import Message, error_text


class Strategy:
    """How a run gets its participants.

    has_links: whether messages between them travel over a transport. slots: what they share files
    by. relay: process that passes on the messages of those on other hosts.
    """

    has_links = False
    relay = 0
    slots: RunSlots = RunSlots()

    def launch(self, run: RunView) -> None:
        """Start them, and hand each to `run.started`.

        Raises StartFailed when one cannot be started.
        """
        raise NotImplementedError


class RunView(Protocol):
    """What an extension, and a host, may use of a run.

    key, token: its key space on the bus, and its secret. state: how far it is; its scenario is
    that of the participants. session: its end of the bus. strategy: how it gets its
    participants. recorder: gets the outputs. timing: gets what the clock shows. out: folder of the
    run. observer: is notified of progress. interrupt: ends the run when it is set. messages: takes
    what participants send. gates: hold steps. descriptions: of all outputs, from the end of the
    start-up on. is_timed: whether the clock says when steps begin. warn: gets a participant and
    what it has left behind. result: returns what result.json would hold, were the run over.
    """

    key: str
    token: str
    state: RunState
    session: Session
    strategy: Strategy
    recorder: Sink
    timing: TimingRecorder
    clock: Clock
    out: Path
    observer: Observer
    interrupt: threading.Event
    messages: MessageHandler
    gates: list[Gate]
    descriptions: Descriptions
    is_timed: bool
    warn: Callable[[str, str], None]
    result: Callable[[], bytes]

    def newest(self, output: str) -> Message | None:
        """Return the newest message of an output, such as `plant.joint_state`; None before one."""

    def end(self, reason: str) -> None:
        """End the run after the steps that are released."""

    def progress(self) -> Progress:
        """Return how far the run is."""

    def receive_last_reports(self, name: str) -> None:
        """Take what is still under way when a process has ended; raises what that reports."""

    def start_options(self, spec: ParticipantSpec) -> dict[str, Any]:
        """Return how a participant is to be started, as far as extensions say so."""

    def started(self, participant: ParticipantState) -> None:
        """Take a participant that has been started."""


class Host(Protocol):
    """Where a run takes place."""

    @property
    def clock(self) -> Clock:
        """Return the time by which the run, and its buses, go."""

    @property
    def disk(self) -> Disk:
        """Return what writes the files of the run."""

    def check(self, scenario: Scenario) -> None:
        """Raise WiringError for a scenario that cannot run here, with every reason."""

    def open(self, run: RunView) -> AbstractContextManager[tuple[Bus, Strategy]]:
        """Open the bus of a run, and return how it gets its participants; end them all."""


class RunExtension:
    """Extends a run. Override the methods that you need; the others do nothing.

    An instance is for one run. All methods are called on the run's own thread, in the order in
    which the extensions were given. A RunFailure that one raises ends the run and is its outcome.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        """End the run with an error message where an extension of the user's own raises."""
        super().__init_subclass__(**options)
        if cls.__module__.partition(".")[0] != __name__.partition(".")[0]:
            for name in _METHODS & vars(cls).keys():
                setattr(cls, name, _translated(vars(cls)[name]))

    run: RunView
    """The run, once `attach` has been called."""

    # --- before the run -------------------------------------------------------------------

    def prepare(self, scenario: Scenario) -> Scenario:
        """Return the scenario to run and record; raises WiringError if it is unsuitable."""
        return scenario

    def adapt(self, scenario: Scenario) -> Scenario:
        """Return the scenario that the participants get; the recording keeps the original."""
        return scenario

    def attach(self, run: RunView) -> None:
        """Attach to the run: its bus is open, and no participant has started."""
        self.run = run

    def start_options(self, spec: ParticipantSpec) -> Mapping[str, Any]:
        """Return options for the start of a participant, as `Launcher.start` takes them.

        folder: working directory; default: that of the scenario.
        """
        return {}

    def started(self, participant: ParticipantState) -> None:
        """React to a participant that was started, or that the user has to start."""

    # --- during the run -------------------------------------------------------------------

    def awaiting(self, participants: Iterable[ParticipantState]) -> None:
        """Watch the participants that are not ready or have not ended yet; called repeatedly."""

    def ready(self) -> None:
        """Check the descriptions of all participants; called before the first step."""

    def turn(self) -> None:
        """Do periodic work; called at each turn of the run loop."""

    def act(self) -> None:
        """Act between two steps, before further steps are released."""

    def completed(self, step: int) -> None:
        """Inspect a complete step before the next one begins.

        Overriding this limits the window to one step, so that decisions do not depend on how far
        ahead participants are.
        """

    def limit(self, released: int) -> int:
        """Return the first step that must not be released yet; default: none.

        released: all steps below it have been released. Called repeatedly.
        """
        return FAR

    def wait_s(self, released: int, longest_s: float) -> float | None:
        """Return how long to wait for messages, at most until the next step is due [s].

        longest_s: wait when no step is due. None: the clock holds no step.
        """
        return None

    # --- at its end -----------------------------------------------------------------------

    def survive(self, failure: RunFailure) -> Callable[[], str] | None:
        """Keep the run going until it comes to rest; None: the failure ends it at once.

        Return a function that gives the end of the error message, called after the last step.
        """
        return None

    def stopping(self) -> None:
        """React to the end of stepping: no further step begins."""

    def close(self) -> None:
        """Release resources; called once after `attach`, also after a failure."""

    def result(self) -> Mapping[str, Any]:
        """Return fields for the run's result."""
        return {}

    def finish(self, result: Result) -> None:
        """Process the result after the recording is closed; may raise RecordingFailed."""


_METHODS = {name for name, value in vars(RunExtension).items() if callable(value)} - {"prepare"}


def _translated(method: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(method)
    def translated(self: RunExtension, *args: Any) -> Any:
        try:
            return method(self, *args)
        except RunFailure:
            raise
        except Exception as exc:
            what = f"the extension {type(self).__name__}, in {method.__name__}"
            raise RunFailure(f"{what}: {error_text(exc)}") from exc

    return translated


def overriding(extensions: Iterable[RunExtension], name: str) -> list[Callable[..., Any]]:
    """Return a method of each extension that has its own; the others cost a step nothing."""
    default = getattr(RunExtension, name)
    return [getattr(item, name) for item in extensions if getattr(type(item), name) is not default]
