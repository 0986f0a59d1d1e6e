"""The bus: the interface that the rest of stepbus knows, and its implementation over Zenoh."""

from .interface import Bus, BusError, Clock, Queue, Request
from .zenoh_bus import ONE_THREAD, ZenohBus, zenoh_settings

__all__ = [
    "ONE_THREAD",
    "Bus",
    "BusError",
    "Clock",
    "Queue",
    "Request",
    "ZenohBus",
    "zenoh_settings",
]
