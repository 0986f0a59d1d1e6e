"""How a participant is connected, for programs that take part without `main`."""

from stepbus_participant import Bus, Endpoint, Ports, PortType, Ticket, load_ticket

__all__ = ["Bus", "Endpoint", "PortType", "Ports", "Ticket", "load_ticket"]
