"""What tools use of the orchestrator beside what users do; all else in its rooms is its own.

Each name is imported when it is first used: a tool loads what it needs, and no more.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stepbus_orchestrator.analysis.divergence import PortComparison
    from stepbus_orchestrator.analysis.findings import findings, replaced
    from stepbus_orchestrator.analysis.signals import (
        Array,
        Signal,
        Tracking,
        TrackingError,
        read_signal,
        read_tracking,
        tracking_pieces,
        tracking_rmse,
    )
    from stepbus_orchestrator.analysis.tolerance import FieldTolerance, Tolerance, differences
    from stepbus_orchestrator.processes.child import Child
    from stepbus_orchestrator.processes.credentials import certificates, passwords
    from stepbus_orchestrator.processes.endpoints import Mesh, make_mesh, new_token, private_folder
    from stepbus_orchestrator.processes.launcher import PYTHON, Launcher
    from stepbus_orchestrator.replay import ReplayResult, replay
    from stepbus_orchestrator.replay.recorded import (
        Recorded,
        envelope,
        recorded_descriptions,
        without_bulk,
    )
    from stepbus_orchestrator.run.bus import open_bus
    from stepbus_orchestrator.run.describe import describe
    from stepbus_orchestrator.run.folder import read_files, scratch_folder
    from stepbus_orchestrator.run.reports import Lateness, Observer, in_units
    from stepbus_orchestrator.run.result import RESULT_FILE, Result
    from stepbus_orchestrator.run.run_scenario import Options, host_of, run

    from .analysis.diff import diff
    from .processes.limits import check_limits
    from .processes.watchdog import Watchdog
    from .recording.timing import StepTiming
    from .replay.rerun import attached_files, unpack_files
    from .run.inprocess import check_scenario
    from .run.kernel.admission import max_message_bytes, welcome_of
    from .run.kernel.descriptions import input_descriptions
    from .run.live_file import LIVE_FILE, Line

_HOMES = {
    "Array": "analysis.signals",
    "Child": "processes.child",
    "FieldTolerance": "analysis.tolerance",
    "LIVE_FILE": "run.live_file",
    "Lateness": "run.reports",
    "Launcher": "processes.launcher",
    "Line": "run.live_file",
    "Mesh": "processes.endpoints",
    "Observer": "run.reports",
    "Options": "run.run_scenario",
    "PYTHON": "processes.launcher",
    "PortComparison": "analysis.divergence",
    "RESULT_FILE": "run.result",
    "Recorded": "replay.recorded",
    "ReplayResult": "replay",
    "Result": "run.result",
    "Signal": "analysis.signals",
    "StepTiming": "recording.timing",
    "Tolerance": "analysis.tolerance",
    "Tracking": "analysis.signals",
    "TrackingError": "analysis.signals",
    "Watchdog": "processes.watchdog",
    "attached_files": "replay.rerun",
    "certificates": "processes.credentials",
    "check_limits": "processes.limits",
    "check_scenario": "run.inprocess",
    "describe": "run.describe",
    "diff": "analysis.diff",
    "differences": "analysis.tolerance",
    "envelope": "replay.recorded",
    "findings": "analysis.findings",
    "host_of": "run.run_scenario",
    "in_units": "run.reports",
    "input_descriptions": "run.kernel.descriptions",
    "make_mesh": "processes.endpoints",
    "max_message_bytes": "run.kernel.admission",
    "new_token": "processes.endpoints",
    "open_bus": "run.bus",
    "passwords": "processes.credentials",
    "private_folder": "processes.endpoints",
    "read_files": "run.folder",
    "read_signal": "analysis.signals",
    "read_tracking": "analysis.signals",
    "recorded_descriptions": "replay.recorded",
    "replaced": "analysis.findings",
    "replay": "replay",
    "run": "run.run_scenario",
    "scratch_folder": "run.folder",
    "tracking_pieces": "analysis.signals",
    "tracking_rmse": "analysis.signals",
    "unpack_files": "replay.rerun",
    "welcome_of": "run.kernel.admission",
    "without_bulk": "replay.recorded",
}
"""Name → its module."""

__all__ = [
    "LIVE_FILE",
    "PYTHON",
    "RESULT_FILE",
    "Array",
    "Child",
    "FieldTolerance",
    "Lateness",
    "Launcher",
    "Line",
    "Mesh",
    "Observer",
    "Options",
    "PortComparison",
    "Recorded",
    "ReplayResult",
    "Result",
    "Signal",
    "StepTiming",
    "Tolerance",
    "Tracking",
    "TrackingError",
    "Watchdog",
    "attached_files",
    "certificates",
    "check_limits",
    "check_scenario",
    "describe",
    "diff",
    "differences",
    "envelope",
    "findings",
    "host_of",
    "in_units",
    "input_descriptions",
    "make_mesh",
    "max_message_bytes",
    "new_token",
    "open_bus",
    "passwords",
    "private_folder",
    "read_files",
    "read_signal",
    "read_tracking",
    "recorded_descriptions",
    "replaced",
    "replay",
    "run",
    "scratch_folder",
    "tracking_pieces",
    "tracking_rmse",
    "unpack_files",
    "welcome_of",
    "without_bulk",
]


def __getattr__(name: str) -> Any:
    """Import a name when it is first used (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__package__}.{_HOMES[name]}"), name)
