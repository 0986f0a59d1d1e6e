"""Errors. Each is a `StepbusError`: a `WiringError`, or the error of a run with its `ExitCode`."""

from typing import TYPE_CHECKING

from .lookup import imported_on_use

if TYPE_CHECKING:
    from stepbus_orchestrator.errors import *
    from stepbus_participant import *
    from stepbus_participant.parameters import Problem
    from stepbus_schemas import *

__all__ = [
    "BusError",
    "BusFailed",
    "CallError",
    "Diverged",
    "ExitCode",
    "ExtraMissing",
    "InputAbsent",
    "Interrupted",
    "InvalidInput",
    "MessageError",
    "OutputError",
    "OutputExists",
    "ParticipantDied",
    "ParticipantFault",
    "Problem",
    "Problems",
    "RecordingFailed",
    "RunError",
    "RunFailure",
    "ScenarioError",
    "SettingsError",
    "StartFailed",
    "StepTimeout",
    "StepbusError",
    "StopTimeout",
    "WiringError",
]

_HOMES = (
    "stepbus_schemas",
    "stepbus_participant",
    "stepbus_participant.parameters",
    "stepbus_orchestrator.errors",
)

__getattr__, __dir__ = imported_on_use(__name__, __all__, _HOMES)
