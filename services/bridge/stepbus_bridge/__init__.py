"""The bridge: takes part in a run on behalf of a program without Zenoh (docs/guide/bridge.md)."""

from .bridge import BridgedProgram
from .link import BridgeError
from .map_bridge import MapBridge
from .raw_bridge import RawBridge

__all__ = ["BridgeError", "BridgedProgram", "MapBridge", "RawBridge"]
