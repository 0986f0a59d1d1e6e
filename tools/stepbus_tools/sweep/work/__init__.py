"""What makes the runs of a sweep: its content, one run, workers on Ray."""

from .content import Content, collect, metric_file
from .metrics import BUILTIN, Value
from .pool import Pace, Pool, Terms
from .trial import KEEP, Row, overrides_of, write_run

__all__ = [
    "BUILTIN",
    "KEEP",
    "Content",
    "Pace",
    "Pool",
    "Row",
    "Terms",
    "Value",
    "collect",
    "metric_file",
    "overrides_of",
    "write_run",
]
