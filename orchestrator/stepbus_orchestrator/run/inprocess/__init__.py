"""A run in one process: participants take turns on one thread, over a bus in memory."""

from stepbus_orchestrator.run.inprocess.program import ScenarioModules

from .local_run import LocalRun, check_scenario
from .surroundings import NATIVE_LOG, Surroundings

__all__ = ["NATIVE_LOG", "LocalRun", "ScenarioModules", "Surroundings", "check_scenario"]
