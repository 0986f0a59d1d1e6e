"""The orchestrator: starts participants, drives them in lockstep, records them."""

from .run.control.live_file import call
from .run.control.pace import Pace
from .run.progress import Observer, Progress
from .run.result import Result
from .run.run_scenario import Options
from .scenario import load

__all__ = ["Observer", "Options", "Pace", "Progress", "Result", "call", "load"]
