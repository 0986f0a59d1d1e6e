"""What scripts call, one class for each kind of thing."""

from importlib import resources

from .joints import Joints
from .objects import Objects, Poses
from .other import Other, Signals
from .sensors import Sensors
from .simulation import Simulation
from .table import CONSTANTS as CONSTANTS
from .table import Group

GROUPS: tuple[type[Group], ...] = (Simulation, Objects, Poses, Joints, Sensors, Signals, Other)
_MORE = resources.files("stepbus_coppelia").joinpath("unavailable.txt").read_text()
UNAVAILABLE = frozenset(_MORE.split())
"""Further ones that scripts call: a client knows them, and their calls are errors by name."""
NAMES = {name for group in GROUPS for name in group.names()}
"""Of all functions, without `sim.`."""
