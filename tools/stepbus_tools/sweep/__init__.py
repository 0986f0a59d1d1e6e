"""Sweeps: many runs of one scenario, on all cores or a cluster, and one table of them."""

from stepbus_tools.sweep.pool import Terms
from stepbus_tools.sweep.result_table import TABLE_FILE
from stepbus_tools.sweep.sweep_page import PAGE_FILE
from stepbus_tools.sweep.trial import KEEP

from .again import Again, rerun_row
from .run_sweep import RUNNING, SweepProgress, SweepResult, sweep
from .spec import SPEC_FILE, Spec, default_name, load_spec
from .spec_check import find_spec

__all__ = [
    "KEEP",
    "PAGE_FILE",
    "RUNNING",
    "SPEC_FILE",
    "TABLE_FILE",
    "Again",
    "Spec",
    "SweepProgress",
    "SweepResult",
    "Terms",
    "default_name",
    "find_spec",
    "load_spec",
    "rerun_row",
    "sweep",
]
