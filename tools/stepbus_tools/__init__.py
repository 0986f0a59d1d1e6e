"""Tools over recordings and around runs: views, reports, exports, sweeps, checks.

They use the public names of the core, which does not know them: it finds them by entry points.
Users import the same from `stepbus`. Each name is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stepbus_tools.sweep import SweepProgress, SweepResult, Terms, default_name, find_spec
    from stepbus_tools.sweep import sweep as sweep_scenario
    from stepbus_tools.viewing.exports import Exported, damage_line
    from stepbus_tools.viewing.exports import export as export_recording
    from stepbus_tools.viewing.page import report as report_recordings

    from .figures import Comparison, FieldError, Metrics
    from .figures import compare as compare_recordings

_HOMES = {
    "Comparison": "figures",
    "Exported": "viewing.exports",
    "FieldError": "figures",
    "Metrics": "figures",
    "SweepProgress": "sweep",
    "SweepResult": "sweep",
    "Terms": "sweep",
    "compare_recordings": "figures:compare",
    "damage_line": "viewing.exports",
    "default_name": "sweep",
    "export_recording": "viewing.exports:export",
    "find_spec": "sweep",
    "report_recordings": "viewing.page:report",
    "sweep_scenario": "sweep:sweep",
}
"""Name → its module, and what it is called there if that is another name."""

__all__ = [
    "Comparison",
    "Exported",
    "FieldError",
    "Metrics",
    "SweepProgress",
    "SweepResult",
    "Terms",
    "compare_recordings",
    "damage_line",
    "default_name",
    "export_recording",
    "find_spec",
    "report_recordings",
    "sweep_scenario",
]


def __getattr__(name: str) -> Any:
    """Import a name when it is first used (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home, _, other = _HOMES[name].partition(":")
    return getattr(import_module(f"{__name__}.{home}"), other or name)
