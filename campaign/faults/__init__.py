"""Faults that strike a run from outside, and what must come of each."""

from .catalogue import FAULTS
from .fault import ANY_END, Fault

__all__ = ["ANY_END", "FAULTS", "Fault"]
