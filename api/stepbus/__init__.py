"""stepbus: co-simulation for robotics in lockstep; what a user does from Python.

Each name is imported when it is first used. What a controller on a robot takes part with loads
nothing of the orchestrator. What is used less is in `stepbus.messages`, `.params`, `.errors`,
`.results`, `.wiring` and `.testing`.
"""

import warnings
from importlib import import_module
from typing import TYPE_CHECKING, Any

from .lookup import imported_on_use

if TYPE_CHECKING:
    from stepbus_orchestrator import (
        ExitCode,
        Observer,
        Pace,
        Progress,
        Recording,
        Result,
        RunExtension,
        RunFailure,
        Scenario,
        ScenarioError,
        Tolerance,
    )
    from stepbus_participant import (
        Config,
        Method,
        Participant,
        Settings,
        Steering,
        Step,
        main,
        take_part,
    )
    from stepbus_schemas import (
        Description,
        Event,
        JointCommand,
        JointReference,
        JointState,
        Message,
        SensedJoints,
        StepbusError,
        WiringError,
    )

    from . import errors, messages, params, results, testing, wiring
    from .recordings import branch, compare, diff, export, recover, replay, report, rerun
    from .runs import call, describe, load, run, verify
    from .sweeps import sweep

_MODULES = ("errors", "messages", "params", "results", "testing", "wiring")
_HOMES = (
    "stepbus_participant",
    "stepbus_schemas",
    ".runs",
    ".recordings",
    ".sweeps",
    "stepbus_orchestrator",
)
"""Where a name of `__all__` comes from: the first that has it."""

__all__ = [
    "Config",
    "Description",
    "Event",
    "ExitCode",
    "JointCommand",
    "JointReference",
    "JointState",
    "Message",
    "Method",
    "Observer",
    "Pace",
    "Participant",
    "Progress",
    "Recording",
    "Result",
    "RunExtension",
    "RunFailure",
    "Scenario",
    "ScenarioError",
    "SensedJoints",
    "Settings",
    "Steering",
    "Step",
    "StepbusError",
    "Tolerance",
    "WiringError",
    "branch",
    "call",
    "compare",
    "describe",
    "diff",
    "errors",
    "export",
    "load",
    "main",
    "messages",
    "params",
    "recover",
    "replay",
    "report",
    "rerun",
    "results",
    "run",
    "sweep",
    "take_part",
    "testing",
    "verify",
    "wiring",
]

_find, __dir__ = imported_on_use(__name__, __all__, _HOMES)


def __getattr__(name: str) -> Any:
    """Import a name when it is first used, a moved one with a warning that says where it is."""
    if name in _MODULES:
        return import_module(f"stepbus.{name}")
    if name == "CheckedScenario":
        _warn(name, "stepbus.Scenario")
        return _find("Scenario")
    if name not in __all__ and (module := _module_of(name)):
        _warn(name, f"stepbus.{module}.{name}")
        return getattr(import_module(f"stepbus.{module}"), name)
    return _find(name)


def _module_of(name: str) -> str:
    """Return where a name is that was here in version 0.1; empty for one that is nowhere."""
    others = (module for module in _MODULES if module != "testing")
    return next((m for m in others if name in import_module(f"stepbus.{m}").__all__), "")


def _warn(name: str, place: str) -> None:
    warnings.warn(
        f"stepbus.{name} is {place} now, and goes with the next version",
        DeprecationWarning,
        stacklevel=3,
    )
