"""The planner: finds ways of a robot's joints that touch nothing, timed within its limits."""

from .participant import PlannerParticipant

__all__ = ["PlannerParticipant"]
