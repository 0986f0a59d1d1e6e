"""Types for the parameters that a participant's `Settings` declare."""

from stepbus_participant.parameters import settings
from stepbus_participant.parameters.settings import *

__all__ = settings.__all__
