"""Where the time of a step goes, measured on request (`stepbus run --profile`)."""

from .profiler import Profiler

__all__ = ["Profiler"]
