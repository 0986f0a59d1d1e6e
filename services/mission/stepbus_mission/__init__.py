"""The mission: references with exact derivatives, from a generator of your choice."""

from .generators import Generator, Sine, StepChange
from .participant import TASKS, MissionParticipant
from .trajectories import CsvTrajectory, Waypoints

__all__ = [
    "TASKS",
    "CsvTrajectory",
    "Generator",
    "MissionParticipant",
    "Sine",
    "StepChange",
    "Waypoints",
]
