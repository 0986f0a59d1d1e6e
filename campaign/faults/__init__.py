"""Faults that strike a run from outside, and what must come of each."""

from .catalogue import FAULTS
from .fault import Fault

__all__ = ["FAULTS", "Fault"]
