"""The bus: the interface that the rest of stepbus knows, and its implementation over Zenoh."""

from .faulty_bus import FaultyBus, FaultyPublisher
from .interface import Bus, BusError, Queue, Request
from .zenoh_bus import ONE_THREAD, ZenohBus, zenoh_settings

__all__ = [
    "ONE_THREAD",
    "Bus",
    "BusError",
    "FaultyBus",
    "FaultyPublisher",
    "Queue",
    "Request",
    "ZenohBus",
    "zenoh_settings",
]
