"""Scenarios: what takes part in a run, how it is coupled, and whether that can work."""

from .load import load
from .locate import builtin_names
from .model import BusSpec, Deadlines, InputSpec, OutputSpec, ParticipantSpec, Scenario
from .problems import Problem, ScenarioError
from .program import command
from .resolve import files, resolved
from .schedule import Schedule

__all__ = [
    "BusSpec",
    "Deadlines",
    "InputSpec",
    "OutputSpec",
    "ParticipantSpec",
    "Problem",
    "Scenario",
    "ScenarioError",
    "Schedule",
    "builtin_names",
    "command",
    "files",
    "load",
    "resolved",
]
