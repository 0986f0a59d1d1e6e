"""One participant's part in a run: admission, handshakes, steps, and the end."""

from .admission import join
from .control import Control
from .inputs import Input, PeerFault, carries_token, make_inputs, make_sources
from .outbox import OutputError, read_stamp, stamp
from .session import Session, Terminated

__all__ = [
    "Control",
    "Input",
    "OutputError",
    "PeerFault",
    "Session",
    "Terminated",
    "carries_token",
    "join",
    "make_inputs",
    "make_sources",
    "read_stamp",
    "stamp",
]
