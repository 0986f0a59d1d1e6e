"""Sweeps: many runs of one scenario, on all cores or a cluster, and one table of them."""

from .execute import SweepProgress, SweepResult, sweep
from .pool import Terms
from .spec import SPEC_FILE, Spec, load_spec, make_spec, read_spec
from .table import TABLE_FILE
from .trial import KEEP

__all__ = [
    "KEEP",
    "SPEC_FILE",
    "TABLE_FILE",
    "Spec",
    "SweepProgress",
    "SweepResult",
    "Terms",
    "load_spec",
    "make_spec",
    "read_spec",
    "sweep",
]
