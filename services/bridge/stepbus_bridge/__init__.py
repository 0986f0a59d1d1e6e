"""The bridge: takes part in a run for a program without Zenoh (docs/guide/writing/bridge.md)."""

from .arguments import bridge_to

__all__ = ["bridge_to"]
