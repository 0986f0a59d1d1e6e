"""The bus: the interface that the rest of stepbus knows, and its implementation over Zenoh."""

from .faulty_bus import FaultyBus
from .interface import Bus, BusError, Request
from .zenoh_bus import ZenohBus, zenoh_settings

__all__ = ["Bus", "BusError", "FaultyBus", "Request", "ZenohBus", "zenoh_settings"]
