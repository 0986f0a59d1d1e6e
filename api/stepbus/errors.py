"""What can fail. Each error is a `StepbusError`: of the wiring, or of a run with its `ExitCode`."""

from typing import TYPE_CHECKING

from .lookup import imported_on_use

if TYPE_CHECKING:
    from stepbus_orchestrator.errors import (
        BusFailed,
        Diverged,
        ExitCode,
        Interrupted,
        OutputExists,
        ParticipantDied,
        ParticipantFault,
        RecordingFailed,
        RunFailure,
        ScenarioError,
        StartFailed,
        StepTimeout,
        StopTimeout,
    )
    from stepbus_participant import (
        BusError,
        CallError,
        ExtraMissing,
        InputAbsent,
        InvalidInput,
        OutputError,
        Problems,
        SettingsError,
    )
    from stepbus_participant.parameters import Problem
    from stepbus_schemas import (
        MessageError,
        RunError,
        StepbusError,
        WiringError,
    )

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
