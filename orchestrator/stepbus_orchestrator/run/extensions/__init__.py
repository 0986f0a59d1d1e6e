"""The features of a run that ship; see docs/guide/writing/extension.md for one of your own."""

from collections.abc import Iterable, Sequence
from typing import TypeVar

from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.scenario import Scenario

from .calls import Calls
from .external import External, StartedHere
from .faults import Faults
from .pace import Pace
from .real_time import RealTime
from .save_checkpoints import SaveCheckpoints
from .speed import Speed
from .steering import Steering

_T = TypeVar("_T", bound=RunExtension)


def with_defaults(
    scenario: Scenario, given: Sequence[RunExtension], *, is_recorded: bool
) -> list[RunExtension]:
    """Return the extensions of a run: those given, and those that every run of a scenario has.

    They act in this order: faults, pause, speed, the others that are given, calls.
    """
    pace = _first(given, Pace) or Pace()
    calls = _first(given, Calls) or Calls()
    speed = Speed(scenario.step_ns)
    real_time = _first(given, RealTime)
    steering = Steering(pace, speed, calls, None if real_time is None else real_time.factor)
    others = [item for item in given if item not in (pace, calls)]
    if _first(given, External) is None:
        others.append(StartedHere())
    if scenario.checkpoint_steps and is_recorded:
        others.insert(0, SaveCheckpoints())
    faults = [Faults()] if scenario.faults else []
    return [*faults, pace, speed, *others, calls, steering]


def _first(items: Iterable[RunExtension], kind: type[_T]) -> _T | None:
    return next((item for item in items if isinstance(item, kind)), None)
