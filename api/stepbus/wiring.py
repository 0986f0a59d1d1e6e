"""How a participant is connected, for those who take part without `main`."""

from typing import TYPE_CHECKING

from .lookup import imported_on_use

if TYPE_CHECKING:
    from stepbus_participant import (
        Bus,
        Endpoint,
        Ports,
        PortType,
        Ticket,
        load_ticket,
    )

__all__ = [
    "Bus",
    "Endpoint",
    "PortType",
    "Ports",
    "Ticket",
    "load_ticket",
]

__getattr__, __dir__ = imported_on_use(__name__, __all__, ("stepbus_participant",))
