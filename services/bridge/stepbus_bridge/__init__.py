"""The bridge: takes part in a run for a program without Zenoh (docs/guide/writing/bridge.md)."""

from .command import take_part

__all__ = ["take_part"]
