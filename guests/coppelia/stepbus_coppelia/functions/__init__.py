"""What scripts call, one module for each kind of thing; the table has all of them by name."""

from . import joints, objects, other, sensors, simulation
from .table import CONSTANTS as CONSTANTS
from .table import FUNCTIONS as FUNCTIONS

__all__ = ["CONSTANTS", "FUNCTIONS", "joints", "objects", "other", "sensors", "simulation"]
