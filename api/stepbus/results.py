"""Types that the functions of `stepbus` return and report, for annotations."""

from typing import TYPE_CHECKING

from .lookup import imported_on_use

if TYPE_CHECKING:
    from stepbus_orchestrator.analysis.diff import Diff
    from stepbus_orchestrator.analysis.verify import Verification
    from stepbus_orchestrator.recording import Recovery
    from stepbus_orchestrator.replay import ReplayResult
    from stepbus_orchestrator.replay.branch import Branch
    from stepbus_orchestrator.replay.rerun import Rerun
    from stepbus_orchestrator.run.describe import ParticipantDescription
    from stepbus_tools.dataframes import Comparison, FieldError
    from stepbus_tools.sweep.run_sweep import SweepProgress, SweepResult
    from stepbus_tools.sweep.sweep_metrics import Metrics
    from stepbus_tools.viewing.exports import Exported

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

_HOMES = (
    "stepbus_orchestrator.analysis.diff",
    "stepbus_orchestrator.analysis.verify",
    "stepbus_orchestrator.recording",
    "stepbus_orchestrator.replay",
    "stepbus_orchestrator.replay.branch",
    "stepbus_orchestrator.replay.rerun",
    "stepbus_orchestrator.run.describe",
    "stepbus_tools.dataframes",
    "stepbus_tools.viewing.exports",
    "stepbus_tools.sweep.run_sweep",
    "stepbus_tools.sweep.sweep_metrics",
)

__getattr__, __dir__ = imported_on_use(__name__, __all__, _HOMES)
