"""The second part: recordings that are damaged or forged, and every command that reads one."""

from .run import Outcome, mutate

__all__ = ["Outcome", "mutate"]
