"""The mission: references with exact derivatives, from a generator of your choice."""

from .references.generators import Generator, Sine, StepChange
from .references.params import Params
from .references.participant import TASKS, MissionParticipant
from .references.trajectories import CsvTrajectory, Waypoints

__all__ = [
    "TASKS",
    "CsvTrajectory",
    "Generator",
    "MissionParticipant",
    "Params",
    "Sine",
    "StepChange",
    "Waypoints",
]
