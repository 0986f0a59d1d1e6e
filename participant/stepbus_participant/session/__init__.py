"""One participant's part in a run: admission, handshakes, steps, and the end."""

from .admission import join
from .bulk import read_stamp, stamp
from .control import Control
from .inputs import Input, PeerFault, make_inputs
from .outbox import OutputError
from .session import Session, Terminated
from .sources import carries_token, make_sources

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
