"""What scripts call, one class for each kind of thing."""

from .joints import Joints
from .objects import Objects, Poses
from .other import Other, Signals
from .sensors import Sensors
from .simulation import Simulation
from .table import CONSTANTS as CONSTANTS
from .table import Group

GROUPS: tuple[type[Group], ...] = (Simulation, Objects, Poses, Joints, Sensors, Signals, Other)
NAMES = {name for group in GROUPS for name in group.names()}
"""Of all functions, without `sim.`."""
