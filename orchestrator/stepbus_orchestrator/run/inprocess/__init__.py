"""A run in one process: participants take turns on one thread, over a bus in memory."""

from .local_run import LocalRun, check_scenario
from .surroundings import Surroundings

__all__ = ["LocalRun", "Surroundings", "check_scenario"]
