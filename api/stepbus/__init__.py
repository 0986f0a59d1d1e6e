"""stepbus: co-simulation for robotics in lockstep; everything a user does from Python.

Each name is imported when it is first used. What a controller on a robot takes part with loads
nothing of the orchestrator.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stepbus_orchestrator import (
        Branch,
        BusFailed,
        Diff,
        Diverged,
        ExitCode,
        Interrupted,
        Observer,
        OutputExists,
        Pace,
        ParticipantDescription,
        ParticipantDied,
        ParticipantFault,
        Problem,
        Progress,
        Recording,
        RecordingFailed,
        Recovery,
        ReplayResult,
        Rerun,
        Result,
        RunExtension,
        RunFailure,
        ScenarioError,
        StartFailed,
        StepTimeout,
        StopTimeout,
        Tolerance,
        Verification,
    )
    from stepbus_orchestrator import Scenario as CheckedScenario
    from stepbus_participant import *
    from stepbus_schemas import *
    from stepbus_tools import Comparison, Exported, SweepProgress, SweepResult

    from . import testing
    from .recordings import branch, compare, diff, export, recover, replay, report, rerun
    from .runs import call, describe, load, run, verify
    from .scenarios import Scenario
    from .sweeps import sweep

_HOMES = (
    "stepbus_participant",
    "stepbus_schemas",
    ".runs",
    ".recordings",
    ".sweeps",
    "stepbus_orchestrator",
    "stepbus_tools",
)
"""Where a name of `__all__` comes from: the first that has it."""

__all__ = [
    "BaseCommand",
    "BaseState",
    "Branch",
    "Bus",
    "BusError",
    "BusFailed",
    "BytesMessage",
    "CallError",
    "CheckedScenario",
    "Comparison",
    "Config",
    "Contacts",
    "ControllerStatus",
    "Count",
    "Description",
    "Detections",
    "Diff",
    "Diverged",
    "Duration",
    "Endpoint",
    "Event",
    "ExitCode",
    "Exported",
    "ExtraMissing",
    "File",
    "Finite",
    "Goal",
    "GoalStatus",
    "GripperCommand",
    "GripperState",
    "Image",
    "Imu",
    "InputAbsent",
    "Interrupted",
    "InvalidInput",
    "JointCommand",
    "JointReference",
    "JointState",
    "LaserScan",
    "Message",
    "MessageError",
    "Method",
    "ModelFile",
    "Name",
    "Names",
    "NonNegative",
    "NonNegativePerJoint",
    "Observer",
    "OutputError",
    "OutputExists",
    "Pace",
    "Participant",
    "ParticipantDescription",
    "ParticipantDied",
    "ParticipantFault",
    "PerJoint",
    "PerName",
    "Plan",
    "PlanRequest",
    "Plugin",
    "PointCloud",
    "PortType",
    "Ports",
    "Poses",
    "Positive",
    "PositivePerJoint",
    "Problem",
    "Problems",
    "Progress",
    "Recording",
    "RecordingFailed",
    "Recovery",
    "ReplayResult",
    "Rerun",
    "Result",
    "RunError",
    "RunExtension",
    "RunFailure",
    "Scalars",
    "Scenario",
    "ScenarioError",
    "SensedJoints",
    "Settings",
    "SettingsError",
    "Share",
    "Spiral",
    "StartFailed",
    "Steering",
    "Step",
    "StepTimeout",
    "StepbusError",
    "StopTimeout",
    "SweepProgress",
    "SweepResult",
    "Text",
    "TextMessage",
    "Ticket",
    "Tolerance",
    "Transforms",
    "Types",
    "Vector3",
    "Verification",
    "Whole",
    "WiringError",
    "Wrench",
    "branch",
    "call",
    "compare",
    "describe",
    "diff",
    "each",
    "export",
    "load",
    "load_ticket",
    "load_types",
    "main",
    "meta",
    "needed_when",
    "recover",
    "replay",
    "report",
    "rerun",
    "run",
    "sweep",
    "take_part",
    "testing",
    "verify",
    "when",
]


def __getattr__(name: str) -> Any:
    """Import a name when it is first used (PEP 562)."""
    if name == "testing":
        return import_module("stepbus.testing")
    if name not in __all__:
        raise AttributeError(f"module 'stepbus' has no attribute {name!r}")
    homes = (import_module(home, __name__) for home in _HOMES)
    value = globals()[name] = next(getattr(h, name) for h in homes if hasattr(h, name))
    return value


def __dir__() -> list[str]:
    return [*__all__, *(name for name in globals() if name.startswith("__"))]
