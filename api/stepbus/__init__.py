"""stepbus: co-simulation for robotics in lockstep; the Python API.

Names are imported on first use, so a controller on a robot loads nothing of the orchestrator. Less
common names are in `stepbus.messages`, `.params`, `.errors`, `.results`, `.wiring` and `.testing`.
"""

from typing import TYPE_CHECKING

from .lookup import imported_on_use

if TYPE_CHECKING:
    from stepbus_orchestrator.analysis.tolerance import Tolerance
    from stepbus_orchestrator.errors import *
    from stepbus_orchestrator.recording import Recording
    from stepbus_orchestrator.run.extension import RunExtension
    from stepbus_orchestrator.run.extensions.pace import Pace
    from stepbus_orchestrator.run.reports import Observer, Progress
    from stepbus_orchestrator.run.result import Result
    from stepbus_orchestrator.scenario.model import Scenario
    from stepbus_participant import *
    from stepbus_schemas import *

    from . import errors, messages, params, results, testing, wiring
    from .recordings import *
    from .runs import *
    from .sweeps import *

_HOMES = (
    "stepbus_participant",
    "stepbus_schemas",
    "stepbus_orchestrator.errors",
    ".runs",
    ".recordings",
    ".sweeps",
    "stepbus_orchestrator.analysis.tolerance",
    "stepbus_orchestrator.run.reports",
)
"""Where a name of `__all__` comes from: the first that has it."""
_MODULES = ("errors", "messages", "params", "results", "testing", "wiring")

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

__getattr__, __dir__ = imported_on_use(__name__, __all__, _HOMES, _MODULES)
