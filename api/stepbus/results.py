"""What the functions of `stepbus` return and report, for annotations."""

from typing import TYPE_CHECKING

from .lookup import imported_on_use

if TYPE_CHECKING:
    from stepbus_orchestrator import (
        Branch,
        Diff,
        ParticipantDescription,
        Recovery,
        ReplayResult,
        Rerun,
        Verification,
    )
    from stepbus_tools import (
        Comparison,
        Exported,
        FieldError,
        Metrics,
        SweepProgress,
        SweepResult,
    )

__all__ = [
    "Branch",
    "Comparison",
    "Diff",
    "Exported",
    "FieldError",
    "Metrics",
    "ParticipantDescription",
    "Recovery",
    "ReplayResult",
    "Rerun",
    "SweepProgress",
    "SweepResult",
    "Verification",
]

__getattr__, __dir__ = imported_on_use(__name__, __all__, ("stepbus_orchestrator", "stepbus_tools"))
