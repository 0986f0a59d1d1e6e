"""How to run a scenario, as opposed to what."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.run.control.pace import Pace
from stepbus_orchestrator.run.loop.strategy import Prefix
from stepbus_orchestrator.scenario import Deadlines, Scenario
from stepbus_participant import ProfileOrder, suggest
from stepbus_schemas import CallRecord, WiringError

from .seat import Seat

PROFILE_FOLDER = "profile"
"""In the folder of a run: a CSV for each participant, and what was sampled."""

# Eleven days; in a ticket and for the bus's queries it has to be a finite number [s].
_SUSPENDED_S = 1e6
_NO_DEADLINES = Deadlines(
    spawn_s=_SUSPENDED_S,
    join_s=_SUSPENDED_S,
    ready_s=_SUSPENDED_S,
    step_s=_SUSPENDED_S,
    stop_s=_SUSPENDED_S,
)


@dataclass(frozen=True, kw_only=True)
class Options:
    """How to run, as opposed to what.

    out: folder of the run's files; made, must be empty. start_order: names of the participants
    in the order they are started; default: that of the scenario. around: is entered before the
    first participant is started and left after the last has ended; it gets their processes by
    name. pace: pauses the run. prefix: the first steps, where they are those of a recording.
    calls: of a recording, made again at their steps. new_calls: made at their steps for the first
    time; one that fails ends the run. debug: names of participants that have the terminal and no
    deadline, to run in a debugger. no_deadline: names of others that have none. admits_external:
    wait for participants with `start: external`; otherwise they are started here. tickets: where
    the tickets of these are put; default: `<name>.ticket` in `out`. in_process: host all
    participants in this process, over a bus in memory. owns_descriptors: then descriptors 1 and 2
    are nobody else's, and what libraries in C print goes to a log. profile: measure where the time
    of each step goes. speedscope: names of participants whose stack is sampled too.
    real_time: steps begin on the grid of the wall clock, so many times faster than it.
    seat: a participant that is no program, in a run in one process; it ends the run.
    is_recorded: whether the run writes run.mcap, timing.mcap and result.json.
    """

    out: Path
    start_order: Sequence[str] | None = None
    around: Callable[[Mapping[str, Child]], AbstractContextManager[object]] = nullcontext
    pace: Pace | None = None
    prefix: Prefix | None = None
    calls: Sequence[CallRecord] = ()
    new_calls: Sequence[CallRecord] = ()
    debug: Sequence[str] = ()
    no_deadline: Sequence[str] = ()
    admits_external: bool = False
    real_time: float | None = None
    tickets: Mapping[str, Path] = field(default_factory=dict)
    in_process: bool = False
    owns_descriptors: bool = False
    profile: bool = False
    speedscope: Sequence[str] = ()
    seat: Seat | None = None
    is_recorded: bool = True

    def profile_order(self) -> ProfileOrder | None:
        """Return what participants should measure of their steps."""
        if not self.profile:
            return None
        folder = self.out.resolve() / PROFILE_FOLDER
        return ProfileOrder(folder=str(folder), sampled=list(self.speedscope))


def check_names(scenario: Scenario, names: Sequence[str], what: str) -> None:
    """Raise WiringError for a name that no participant has; what: should be done to it."""
    known = [spec.name for spec in scenario.participants]
    for name in names:
        if name not in known:
            raise WiringError(f"no participant {name!r} to {what}{suggest(name, known)}")


def without_deadlines(scenario: Scenario, names: Sequence[str]) -> Scenario:
    """Return a scenario in which the participants of some names have no deadlines.

    Raises WiringError for a name that no participant has.
    """
    check_names(scenario, names, "debug")
    specs = (
        dataclasses.replace(s, deadlines=_NO_DEADLINES) if s.name in names else s
        for s in scenario.participants
    )
    return dataclasses.replace(scenario, participants=tuple(specs))
