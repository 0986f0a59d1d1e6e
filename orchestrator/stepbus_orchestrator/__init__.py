"""The orchestrator: starts participants, drives them in lockstep, records them."""

from .progress import Observer, Progress
from .result import Result
from .run import Options, run
from .scenario import load

__all__ = ["Observer", "Options", "Progress", "Result", "load", "run"]
