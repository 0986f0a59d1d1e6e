"""The features of a run that ship; see docs/guide/writing/extension.md for one of your own."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from stepbus_orchestrator.run.extension import RunExtension
from stepbus_orchestrator.run.extensions.calls import Calls
from stepbus_orchestrator.run.extensions.external import External, StartedHere
from stepbus_orchestrator.run.extensions.faults import Faults
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.extensions.placement import Placement
from stepbus_orchestrator.run.extensions.real_time import RealTime, Speed
from stepbus_orchestrator.run.extensions.safe_stop import SafeStop
from stepbus_orchestrator.run.extensions.save_checkpoints import SaveCheckpoints
from stepbus_orchestrator.run.extensions.steering import Steering
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_participant import load_class
from stepbus_schemas import WiringError, error_text

_T = TypeVar("_T", bound=RunExtension)


def with_defaults(
    scenario: Scenario, given: Sequence[RunExtension], *, is_recorded: bool
) -> list[RunExtension]:
    """Return the extensions of a run: those given, and those that every run of a scenario has.

    They act in this order: faults, pause, speed, the others that are given, calls, placement.
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
    if any(spec.hold is not None for spec in scenario.participants):
        others.append(SafeStop())
    faults = [Faults()] if scenario.faults else []
    return [*faults, pace, speed, *others, calls, steering, Placement()]


def _first(items: Iterable[RunExtension], kind: type[_T]) -> _T | None:
    return next((item for item in items if isinstance(item, kind)), None)


def load_extension(name: str) -> RunExtension:
    """Return an instance of the class that a name such as `limits.py:Limit` names.

    Raises WiringError where there is no such file or class, it is no RunExtension, or it cannot be
    made without arguments.
    """
    extension = load_class(name, Path.cwd())
    if not issubclass(extension, RunExtension):
        raise WiringError(f"{name}: {extension.__name__} is not a stepbus.RunExtension")
    try:
        made: RunExtension = extension()
    except Exception as exc:
        raise WiringError(f"{name} cannot be created: {error_text(exc)}") from exc
    return made
