"""Sweeps: many runs of one scenario, on all cores or a cluster, and one table of them."""

from .again import Again, rerun_row
from .results import PAGE_FILE, TABLE_FILE
from .run_sweep import RUNNING, SweepProgress, SweepResult, sweep
from .spec import SPEC_FILE, Spec, default_name, load_spec
from .spec_check import find_spec
from .work import KEEP, Terms

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
