"""Types for the parameters that a participant's `Settings` declare."""

from stepbus_participant.parameters import kinds, settings
from stepbus_participant.parameters.kinds import *
from stepbus_participant.parameters.settings import *

__all__ = kinds.__all__ + settings.__all__
