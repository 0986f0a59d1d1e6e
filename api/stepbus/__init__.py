"""stepbus: co-simulation for robotics in lockstep; everything a user does from Python.

Names are imported when they are first used, so that a controller on a robot loads only what it
takes part with.
"""

from stepbus_participant import *  # noqa: F403
from stepbus_participant import __all__ as __all__
