"""The orchestrator: starts participants, drives them in lockstep, records them."""

from .live_file import call
from .pace import Pace
from .progress import Observer, Progress
from .result import Result
from .run import Options, run
from .scenario import load

__all__ = ["Observer", "Options", "Pace", "Progress", "Result", "call", "load", "run"]
