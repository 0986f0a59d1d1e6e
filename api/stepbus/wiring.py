"""Connect a participant to a run, for programs that do not use `main`."""

from stepbus_participant import Bus, Endpoint, Ports, PortType, Ticket, load_ticket

__all__ = ["Bus", "Endpoint", "PortType", "Ports", "Ticket", "load_ticket"]
