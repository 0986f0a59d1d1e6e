"""How a participant is connected, for those who take part without `main`."""

from stepbus_participant import Bus, Endpoint, Ports, PortType, Ticket, load_ticket

__all__ = ["Bus", "Endpoint", "PortType", "Ports", "Ticket", "load_ticket"]
