"""What a participant imports.

Modules that only some participants need are imported on first use: each participant is a process
and loads this package at every start.
"""

from typing import TYPE_CHECKING

from stepbus_schemas import suggest as suggest

from .bus import *
from .bus.slots import SlotError as SlotError
from .bus.slots import SlotWriter as SlotWriter
from .bus.slots import file_name as file_name
from .bus.slots import read_slot as read_slot
from .bus.ticket import *
from .bus.zenoh_bus import *
from .calls import *
from .config import *
from .disk import *
from .files import *
from .inputs import Input as Input
from .packages import *
from .parameters.durations import *
from .parameters.kinds import *
from .parameters.kinds import Own as Own
from .parameters.problems import *
from .parameters.settings import *
from .participant import *
from .process import *
from .session.outbox import OutputError as OutputError
from .session.outbox import OutputPorts as OutputPorts
from .session.outbox import names_of as names_of
from .session.outbox import read_stamp as read_stamp
from .session.outbox import stamp as stamp
from .session.session import take_part as take_part
from .user_classes import *

if TYPE_CHECKING:
    from .bus.loopback import *
    from .parameters.types_file import *

_LATER = {
    "LoopbackBus": "bus.loopback",
    "load_types": "parameters.types_file",
}
"""Name → module that is imported when it is first used."""

__getattr__ = imported_later(__name__, _LATER)
