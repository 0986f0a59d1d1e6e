"""All built-in message types, and the tools to declare your own."""

from stepbus_participant import load_types
from stepbus_schemas import Types, messages
from stepbus_schemas.messages import *

__all__ = ["Types", "load_types"]
__all__ += messages.__all__
